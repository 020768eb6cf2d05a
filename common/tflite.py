"""Reads TensorFlow Lite models, and leaves out of one what nobody reads; pure.

A model is a FlatBuffer; the slots are those of tensorflow/lite/schema/schema.fbs. A new head lies in front of the old
file, which stays as it is (common/flat_buffer.py).
"""

import io
import struct
import zipfile

from common.flat_buffer import Bytes, Existing, FlatTable, FlatTables, Node, flat_buffer

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
    version = field(model, root, VERSION)
    whole = {VERSION: 0 if version is None else number(model, version), **fields(model, root, range(1, MODEL_SLOTS))}
    return flat_buffer(FlatTable(whole | changed), MODEL, model)


def fields(content: bytes, table: int, slots: range) -> "dict[int, int | Node]":
    """What these fields of a table refer to."""
    places = {slot: field(content, table, slot) for slot in slots}
    return {slot: Existing(reference(content, place)) for slot, place in places.items() if place is not None}


def number(content: bytes, place: int) -> int:
    """The uint32 at byte `place` of the file."""
    return int(struct.unpack_from("<I", content, place)[0])


def reference(content: bytes, place: int) -> int:
    """The byte to which the reference at byte `place` leads."""
    return place + number(content, place)


def field(content: bytes, table: int, slot: int) -> int | None:
    """Where a field of the table lies; None: it has its default."""
    vtable = table - int(struct.unpack_from("<i", content, table)[0])
    if 4 + 2 * slot >= struct.unpack_from("<H", content, vtable)[0]:
        return None
    distance = int(struct.unpack_from("<H", content, vtable + 4 + 2 * slot)[0])
    return table + distance if distance else None


def vector(content: bytes, table: int, slot: int) -> range:
    """Where the items of a vector lie, four bytes each."""
    place = field(content, table, slot)
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
