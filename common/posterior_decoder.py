"""Decodes the posteriors of one observer: most differ from the one before in a few numbers alone. Pure.

1. A message is unpacked and checked in full by wire.py. What it consists of is then known, byte for byte: its layout.
2. If the next message has the same bytes but for the numbers of the layout, these are read from their places. Nothing
   else needs a check, because it was checked before. Numbers that are not plainly in range are left to the full check,
   which corrects round-off, or raises BadMessage.
3. A facing differs in every message, and its numbers in their length: one that has it is always checked in full.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass

from common.facets import SUM_TOLERANCE
from common.keys import observer_of, scene_of
from common.message_types import LAST_INTEGER, unchecked
from common.messages import PosteriorMessage, VocabularyHash
from common.wire import checked, field_places, unpack, wrong_key

INTEGERS = ("seq", "captured_ns", "sent_ns", "frames")
PROBABILITIES = ("rest", "unlearned")
PLACES_LIMIT = 256
"""Of more movements, or of more values of all facets, no layout is kept: it takes 60 bytes for each."""
TAGGED_INTEGERS = {0xCC: "B", 0xCD: "H", 0xCE: "I", 0xCF: "Q"}
TAGGED_FLOATS = {0xCA: "f", 0xCB: "d"}
"""The byte before a number in MessagePack, and the number's format in `struct`."""
SMALL_INTEGER = "b"
"""An integer below 128 has no such byte. Read as signed, anything else in its place is below 0."""


class PosteriorDecoder:
    """Decodes the posteriors that arrive under one key, as `wire.decode_from` does, most in less than half its time."""

    def __init__(self, key: str) -> None:
        self.key, self.scene, self.observer = key, scene_of(key), observer_of(key)
        self._fields: object = None
        self._vocabulary: VocabularyHash | None = None
        self._layout: PosteriorLayout | None = None

    def decode(self, payload: bytes) -> PosteriorMessage:
        """The checked message; raises BadMessage."""
        if self._layout is not None and (message := self._layout.read(payload)) is not None:
            return message
        fields = unpack(payload)
        vocabulary, known = fields.get("vocabulary"), self._vocabulary
        if known is not None and vocabulary == self._fields:
            fields["vocabulary"] = known
        message = checked(PosteriorMessage, fields)
        if message.vocabulary is not known:
            self._fields, self._vocabulary = vocabulary, message.vocabulary
        if not message.is_of(self.scene, self.observer):
            raise wrong_key(message.observer, message.scene, self.key)
        places = max(len(message.p), sum(map(len, (message.facets or {}).values())))
        is_steady = message.facing is None and places <= PLACES_LIMIT
        self._layout = PosteriorLayout.of(message, payload) if is_steady else None
        return message


@dataclass(frozen=True, slots=True)
class _Distribution:
    """The bytes of a distribution: the tag of each number, alike in most, and the numbers."""

    numbers: struct.Struct
    tags: bytes
    distance: int

    @classmethod
    def of(cls, block: bytes, number_format: str) -> "_Distribution":
        distance = _number_size(number_format)
        numbers = struct.Struct(">" + f"x{number_format}" * (len(block) // distance))
        return cls(numbers, block[::distance], distance)

    def read(self, block: bytes) -> list[float] | None:
        """The probabilities; None if they have another layout, or are not plainly a distribution."""
        if block[:: self.distance] != self.tags:
            return None
        p = self.numbers.unpack(block)
        least = min(p)
        # The sum is NaN if one of them is, and then no comparison holds.
        if not (least >= 0.0 and max(p) <= 1.0 and abs(sum(p) - 1) <= SUM_TOLERANCE):
            return None
        # No number changes but -0.0, which becomes 0.0.
        return list(p) if least > 0.0 else [probability + 0.0 for probability in p]


@dataclass(frozen=True, slots=True, order=True)
class _Place:
    """Where the number of a field begins, or the first tag of a distribution.

    number_format: "" if it is not of the usual type. count: numbers in a distribution, 0 for a single number. facet:
    whether `name` is that of a facet.
    """

    begin: int
    number_format: str
    name: str
    count: int = 0
    facet: bool = False

    @property
    def block_format(self) -> str:
        """Of the number, or of the distribution as one block of bytes."""
        return f"{_number_size(self.number_format) * self.count}s" if self.count else self.number_format


class PosteriorLayout:
    """The places of the numbers in the bytes of a posterior, and what is between them.

    structure: of the whole message, bytes and numbers by turns; a distribution, one block of bytes, is one number here.
    places: those of the numbers, in order.
    """

    def __init__(
        self, message: PosteriorMessage, payload: bytes, structure: struct.Struct, places: list[_Place]
    ) -> None:
        values = structure.unpack(payload)
        self._structure, self._fixed, numbers = structure, values[::2], values[1::2]
        self._fields, self._given = vars(message), message.model_fields_set
        single = [(place.name, n) for n, place in enumerate(places) if not place.count]
        self._integers = [(name, n) for name, n in single if name in INTEGERS]
        self._probabilities = [(name, n) for name, n in single if name in PROBABILITIES]
        blocks = [
            (place, n, _Distribution.of(numbers[n], place.number_format))
            for n, place in enumerate(places)
            if place.count
        ]
        self._p_place, self._p = next((n, block) for place, n, block in blocks if not place.facet)
        of_facet = {place.name: (n, block) for place, n, block in blocks if place.facet}
        # In the order of the message, in which they stand in its fields too.
        self._facets = [(name, *of_facet[name]) for name in message.facets or ()]

    @classmethod
    def of(cls, message: PosteriorMessage, payload: bytes) -> "PosteriorLayout | None":
        """The layout of a message that was decoded from `payload`; None if it has numbers of other types."""
        formats, end, places = [">"], 0, sorted(_places(message, payload))
        for place in places:
            if not place.number_format:
                return None
            formats.append(f"{place.begin - end}s{place.block_format}")
            end = place.begin + struct.calcsize(">" + place.block_format)
        structure = struct.Struct("".join([*formats, f"{len(payload) - end}s"]))
        return cls(message, payload, structure, places)

    def read(self, payload: bytes) -> PosteriorMessage | None:
        """The message in `payload`; None if it has another layout, or numbers that are not plainly in range."""
        if len(payload) != self._structure.size:
            return None
        values = self._structure.unpack(payload)
        if values[::2] != self._fixed:
            return None
        numbers, fields = values[1::2], self._fields.copy()
        for name, place in self._integers:
            fields[name] = number = numbers[place]
            if not 0 <= number <= LAST_INTEGER:
                return None
        for name, place in self._probabilities:
            fields[name] = number = numbers[place] + 0.0
            if not 0.0 <= number <= 1.0:
                return None
        fields["p"] = p = self._p.read(numbers[self._p_place])
        if p is None:
            return None
        if self._facets:
            fields["facets"] = facets = {name: block.read(numbers[place]) for name, place, block in self._facets}
            if None in facets.values():
                return None
        return unchecked(PosteriorMessage, fields, self._given)


def _places(message: PosteriorMessage, payload: bytes) -> Iterator[_Place]:
    """The place of each number and distribution."""
    places = field_places(payload)
    for name in INTEGERS:
        at = places[name]
        tagged = TAGGED_INTEGERS.get(payload[at])
        yield _Place(at + 1, tagged, name) if tagged else _Place(at, SMALL_INTEGER if payload[at] < 0x80 else "", name)
    for name in PROBABILITIES:
        if getattr(message, name) is not None:
            yield _Place(places[name] + 1, TAGGED_FLOATS.get(payload[places[name]], ""), name)
    yield _distribution_place("p", len(message.p), payload, places["p"])
    if message.facets:
        facets = field_places(payload, places["facets"])
        for name, values in message.facets.items():
            yield _distribution_place(name, len(values), payload, facets[name], facet=True)


def _distribution_place(name: str, count: int, payload: bytes, at: int, facet: bool = False) -> _Place:
    at += {0xDC: 3, 0xDD: 5}.get(payload[at], 1)
    tag, number_format = payload[at : at + 1], TAGGED_FLOATS.get(payload[at], "")
    size = _number_size(number_format)
    # If the first is of this type, the tag of the second comes at this distance, and so on.
    is_of_one_type = payload[at : at + count * size : size] == tag * count
    return _Place(at, number_format if is_of_one_type else "", name, count, facet)


def _number_size(number_format: str) -> int:
    """Bytes of a number with its tag."""
    return 1 + struct.calcsize(">" + number_format)
