"""Writes FlatBuffers from front to back, as far as the models of the phone need them; pure.

Format: https://flatbuffers.dev/internals, all numbers little endian. A table is a vtable (where each field lies) and
the fields; text, vectors and further tables lie behind it, each at a distance that its field holds.
"""

import struct
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
