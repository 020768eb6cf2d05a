"""Decodes the posteriors of one observer: most differ from the one before in a few numbers alone. Pure.

1. A message is unpacked and checked in full by wire.py. What it consists of is then known, byte for byte: its layout.
2. If the next message has the same bytes but for the numbers of the layout, these are read from their places. Nothing
   else needs a check, because it was checked before. Numbers that are not plainly in range are left to the full check,
   which corrects round-off, or raises BadMessage.
3. Facings and facets differ in every message: one that has them is always checked in full.
"""

import struct
from collections.abc import Iterator

from common.facets import SUM_TOLERANCE
from common.keys import observer_of, scene_of
from common.message_types import LAST_INTEGER, unchecked
from common.messages import PosteriorMessage, VocabularyHash
from common.wire import checked, field_places, unpack, wrong_key

INTEGERS = ("seq", "captured_ns", "sent_ns", "frames")
PROBABILITIES = ("rest", "unlearned")
MOVEMENTS_LIMIT = 256
"""A layout of more is not kept: it takes 60 bytes for each."""
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
        is_steady = message.facing is None and not message.facets and len(message.p) <= MOVEMENTS_LIMIT
        self._layout = PosteriorLayout.of(message, payload) if is_steady else None
        return message


class PosteriorLayout:
    """The places of the numbers in the bytes of a posterior, and what is between them.

    structure: of the whole message, bytes and numbers by turns; `p`, one block of bytes, is one number here. names: of
    the numbers, in order. p_format: of each of its numbers.
    """

    def __init__(
        self, message: PosteriorMessage, payload: bytes, structure: struct.Struct, names: list[str], p_format: str
    ) -> None:
        self._structure, self._fixed = structure, structure.unpack(payload)[::2]
        self._fields, self._given = vars(message), message.model_fields_set
        self._integers = [(name, place) for place, name in enumerate(names) if name in INTEGERS]
        self._probabilities = [(name, place) for place, name in enumerate(names) if name in PROBABILITIES]
        self._p_place, self._p = names.index("p"), struct.Struct(">" + f"x{p_format}" * len(message.p))
        self._tag_distance = self._p.size // len(message.p)
        self._p_tags = structure.unpack(payload)[1::2][self._p_place][:: self._tag_distance]

    @classmethod
    def of(cls, message: PosteriorMessage, payload: bytes) -> "PosteriorLayout | None":
        """The layout of a message that was decoded from `payload`; None if it has numbers of other types."""
        formats, names, end, p_format = [">"], [], 0, ""
        for begin, number_format, name in sorted(_numbers(message, payload)):
            if not number_format:
                return None
            p_format = number_format if name == "p" else p_format
            number_format = f"{_number_size(number_format) * len(message.p)}s" if name == "p" else number_format
            formats.append(f"{begin - end}s{number_format}")
            names.append(name)
            end = begin + struct.calcsize(">" + number_format)
        structure = struct.Struct("".join([*formats, f"{len(payload) - end}s"]))
        return cls(message, payload, structure, names, p_format)

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
            # No number changes but -0.0, which becomes 0.0.
            fields[name] = number = numbers[place] + 0.0
            if not 0.0 <= number <= 1.0:
                return None
        p_block = numbers[self._p_place]
        if p_block[:: self._tag_distance] != self._p_tags:
            return None
        p = self._p.unpack(p_block)
        least = min(p)
        # The sum is NaN if one of them is, and then no comparison holds.
        if not (least >= 0.0 and max(p) <= 1.0 and abs(sum(p) - 1) <= SUM_TOLERANCE):
            return None
        fields["p"] = list(p) if least > 0.0 else [probability + 0.0 for probability in p]
        return unchecked(PosteriorMessage, fields, self._given)


def _numbers(message: PosteriorMessage, payload: bytes) -> Iterator[tuple[int, str, str]]:
    """Where each number begins, or the first tag of `p`; its format ("": not of the usual type); and its field."""
    places = field_places(payload)
    for name in INTEGERS:
        at = places[name]
        tagged = TAGGED_INTEGERS.get(payload[at])
        yield (at + 1, tagged, name) if tagged else (at, SMALL_INTEGER if payload[at] < 0x80 else "", name)
    for name in PROBABILITIES:
        if getattr(message, name) is not None:
            yield places[name] + 1, TAGGED_FLOATS.get(payload[places[name]], ""), name
    at = places["p"] + {0xDC: 3, 0xDD: 5}.get(payload[places["p"]], 1)
    tag, number_format, count = payload[at : at + 1], TAGGED_FLOATS.get(payload[at], ""), len(message.p)
    size = _number_size(number_format)
    # If the first is of this type, the tag of the second comes at this distance, and so on.
    is_of_one_type = payload[at : at + count * size : size] == tag * count
    yield at, number_format if is_of_one_type else "", "p"


def _number_size(number_format: str) -> int:
    """Bytes of a number with its tag."""
    return 1 + struct.calcsize(">" + number_format)
