"""Reads TensorFlow Lite models, leaves out of one what nobody reads, and writes FlatBuffers from front to back; pure.

A model is a FlatBuffer (https://flatbuffers.dev/internals, all numbers little endian); the slots are those of
tensorflow/lite/schema/schema.fbs. A table is a vtable (where each field lies) and the fields; text, vectors and further
tables lie behind it, each at a distance that its field holds. A new head lies in front of the old file, which stays as
it is.
"""

import io
import struct
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import singledispatchmethod

WORD = 4
"""Bytes of a field as it is written here: none is wider, and narrower ones leave the rest empty."""
ALIGNED = 16
"""Bytes; TensorFlow Lite wants weights and numbers at multiples of it."""


@dataclass(frozen=True, slots=True)
class FlatTable:
    """fields: slot of the schema -> a whole number of at most 32 bits, or what the field refers to."""

    fields: "Mapping[int, int | Node]"


@dataclass(frozen=True, slots=True)
class Bytes:
    """A vector of numbers, `count` in `content`; text is one with a zero behind it."""

    content: bytes
    count: int


@dataclass(frozen=True, slots=True)
class FlatTables:
    """A vector of tables."""

    items: "Sequence[Node]"


@dataclass(frozen=True, slots=True)
class Existing:
    """A table or vector at `position` of the older file that is kept behind what is written."""

    position: int


Node = FlatTable | Bytes | FlatTables | Existing


def text(word: str) -> Bytes:
    """A string as FlatBuffers store it: UTF-8, and a zero behind it that does not count."""
    return Bytes(word.encode() + b"\0", len(word.encode()))


def floats(*values: float) -> Bytes:
    """A vector of these numbers as float32."""
    return Bytes(struct.pack(f"<{len(values)}f", *values), len(values))


def flat_buffer(root: FlatTable, identifier: bytes, older: bytes = b"") -> bytes:
    """The file with that root and four letters as `identifier`; `older`: a whole file, to which `Existing` refers."""
    writer = _Writer()
    writer.out += bytes(WORD) + identifier
    writer.refer(0, root)
    writer.pad(ALIGNED)
    for place, position in writer.existing:
        writer.point(place, len(writer.out) + position)
    return bytes(writer.out) + older


@dataclass(slots=True)
class _Writer:
    out: bytearray = field(default_factory=bytearray)
    existing: list[tuple[int, int]] = field(default_factory=list)

    def pad(self, multiple: int, before: int = 0) -> None:
        """Go on where `before` bytes from here a multiple is reached."""
        self.out += bytes(-(len(self.out) + before) % multiple)

    def point(self, place: int, target: int) -> None:
        """Write the distance to `target` at `place`."""
        struct.pack_into("<I", self.out, place, target - place)

    def refer(self, place: int, node: Node) -> None:
        """Write `node`, and at `place` where it is."""
        if isinstance(node, Existing):
            self.existing.append((place, node.position))
        else:
            self.point(place, self.write(node))

    @singledispatchmethod
    def write(self, node: Node) -> int:
        """Write a node and all that it refers to; returns where it begins."""
        raise TypeError(node)

    @write.register
    def _(self, node: Bytes) -> int:
        self.pad(ALIGNED, WORD)
        start = len(self.out)
        self.out += struct.pack("<I", node.count) + node.content
        return start

    @write.register
    def _(self, node: FlatTables) -> int:
        self.pad(WORD)
        start = len(self.out)
        self.out += struct.pack("<I", len(node.items)) + bytes(WORD * len(node.items))
        for number, item in enumerate(node.items, 1):
            self.refer(start + WORD * number, item)
        return start

    @write.register
    def _(self, node: FlatTable) -> int:
        slots = range(max(node.fields, default=-1) + 1)
        places = {slot: WORD * number for number, slot in enumerate(sorted(node.fields), 1)}
        lengths = 4 + 2 * len(slots), WORD * (1 + len(places))
        vtable = struct.pack(f"<{2 + len(slots)}H", *lengths, *(places.get(slot, 0) for slot in slots))
        self.pad(WORD, len(vtable))
        self.out += vtable
        start = len(self.out)
        self.out += struct.pack("<i", len(vtable)) + bytes(WORD * len(places))
        for slot, value in node.fields.items():
            if isinstance(value, int):
                struct.pack_into("<I", self.out, start + places[slot], value)
            else:
                self.refer(start + places[slot], value)
        return start


MODEL = b"TFL3"
VERSION, SUBGRAPHS, MODEL_SLOTS = 0, 2, 8
"""Slots of a model."""
TENSORS, OUTPUTS, OPERATIONS, GRAPH_SLOTS = 0, 2, 3, 5
"""Slots of a graph."""
TENSOR_SHAPE = 0
"""Slot of a tensor."""
READS, WRITES = 1, 2
"""Slots of an operation."""
LANDMARK_OUTPUTS, PRESENCE, OUTLINE = 5, 1, 2
"""Of the outputs of MediaPipe's model of a pose: whether somebody is there, one number, and the person's outline."""
OUTLINE_SHAPE = [1, 256, 256, 1]
ANY_DATE = (1980, 1, 1, 0, 0, 0)
"""Without a date of its own the same models make the same .task file."""


def task_without_outline(task: bytes) -> bytes:
    """The .task file of MediaPipe's pose landmarker, whose model draws no outline; another file as it is."""
    buffer = io.BytesIO()
    try:
        with zipfile.ZipFile(io.BytesIO(task)) as old, zipfile.ZipFile(buffer, "w") as new:
            for name in old.namelist():
                new.writestr(zipfile.ZipInfo(name, ANY_DATE), without_outline(old.read(name)))
    except zipfile.BadZipFile:
        return task
    return buffer.getvalue()


def without_outline(model: bytes) -> bytes:
    """MediaPipe's model of a pose without the operations that only draw the person's outline; another one as it is.

    They take two fifths of its time. In the outline's place among the outputs is the presence; the others are the same.
    """
    try:
        return _without_outline(model)
    except (struct.error, IndexError, ValueError):
        return model


def _without_outline(model: bytes) -> bytes:
    root = reference(model, 0)
    [graph] = items(model, root, SUBGRAPHS)
    outputs = whole_numbers(model, graph, OUTPUTS)
    outline = items(model, graph, TENSORS)[outputs[OUTLINE]]
    if len(outputs) != LANDMARK_OUTPUTS or whole_numbers(model, outline, TENSOR_SHAPE) != OUTLINE_SHAPE:
        return model
    outputs[OUTLINE] = outputs[PRESENCE]
    needed, kept = set(outputs), list[Existing]()
    for operation in reversed(items(model, graph, OPERATIONS)):
        if needed.intersection(whole_numbers(model, operation, WRITES)):
            needed.update(whole_numbers(model, operation, READS))
            kept.insert(0, Existing(operation))
    inner = fields(model, graph, range(GRAPH_SLOTS))
    inner[OUTPUTS] = Bytes(struct.pack(f"<{len(outputs)}i", *outputs), len(outputs))
    inner[OPERATIONS] = FlatTables(kept)
    return with_fields(model, {SUBGRAPHS: FlatTables([FlatTable(inner)])})


def with_fields(model: bytes, changed: "dict[int, Node]") -> bytes:
    """The model with these fields in place of its own."""
    root = reference(model, 0)
    version = field_place(model, root, VERSION)
    whole = {VERSION: 0 if version is None else number(model, version), **fields(model, root, range(1, MODEL_SLOTS))}
    return flat_buffer(FlatTable(whole | changed), MODEL, model)


def fields(content: bytes, table: int, slots: range) -> "dict[int, int | Node]":
    """What these fields of a table refer to."""
    places = {slot: field_place(content, table, slot) for slot in slots}
    return {slot: Existing(reference(content, place)) for slot, place in places.items() if place is not None}


def number(content: bytes, place: int) -> int:
    """The uint32 at byte `place` of the file."""
    return int(struct.unpack_from("<I", content, place)[0])


def reference(content: bytes, place: int) -> int:
    """The byte to which the reference at byte `place` leads."""
    return place + number(content, place)


def field_place(content: bytes, table: int, slot: int) -> int | None:
    """Where a field of the table lies; None: it has its default."""
    vtable = table - int(struct.unpack_from("<i", content, table)[0])
    if 4 + 2 * slot >= struct.unpack_from("<H", content, vtable)[0]:
        return None
    distance = int(struct.unpack_from("<H", content, vtable + 4 + 2 * slot)[0])
    return table + distance if distance else None


def vector(content: bytes, table: int, slot: int) -> range:
    """Where the items of a vector lie, four bytes each."""
    place = field_place(content, table, slot)
    if place is None:
        return range(0)
    start = reference(content, place)
    return range(start + 4, start + 4 + 4 * number(content, start), 4)


def whole_numbers(content: bytes, table: int, slot: int) -> list[int]:
    """The numbers of a vector."""
    return [int(struct.unpack_from("<i", content, place)[0]) for place in vector(content, table, slot)]


def items(content: bytes, table: int, slot: int) -> list[int]:
    """Where the tables of a vector begin."""
    return [reference(content, place) for place in vector(content, table, slot)]
