"""The types of the fields of messages: numbers with their ranges, distributions in few bytes, facings. Pure."""

from collections.abc import Sequence
from functools import cache
from typing import Annotated, Any, Final, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, FiniteFloat, model_validator

ROUND_OFF = 1e-6
"""A probability or entropy may be outside its range by this much: more than a softmax in float32 loses."""
TEXT_LIMIT = 200
"""Characters of a text for people; what is over it is cut off."""
ID_LIMIT = 128
"""Characters of what identifies a session, a movement or a vocabulary."""
CONTRADICTED = 0.6
"""An observer that is relied on less than this is contradicted by the others; honest ones of people stay above .85."""
OVERLOADED = "too slow for all of them"
"""Part of the reason of a process that is degraded because it cannot keep up; after the next semicolon, what to do."""
STANDING_BY: Final = "standing by"
"""How the reason of a fusion service begins that publishes nothing, because another one does."""
SAME_ID_REASON: Final = "another process has this id"
"""The reason in the status of a fusion service that has noticed a second process of its id."""
LABELS_LIMIT = 10_000
PARTS_LIMIT = 256
"""Body parts of one observer."""
LABEL_LIMIT: Final = 64
"""Characters of a label, as `common.vocabulary.LABEL` has it."""
LAST_INTEGER: Final = 2**63 - 1
SURPRISE_LIMIT: Final = 255
"""The largest surprise in a message: P = e^-32."""
FACINGS_LIMIT: Final = 72
"""Directions of a facing: 5 degrees apart."""
ROOT_LIMIT: Final = 255
"""The root of a probability of 1 in a message."""


def printable(text: str) -> str:
    """`text` with `?` for characters that could control a terminal; whatever comes over the network may have some."""
    if text.isprintable():
        return text
    return "".join(character if character.isprintable() else "?" for character in text)


def _clamp(value: float) -> float:
    if 0.0 < value <= 1.0:
        return value
    # max(-0.0, 0.0) may keep the sign; adding 0.0 clears it.
    return min(max(value, 0.0), 1.0) + 0.0


def _clamp_all(values: list[float]) -> list[float]:
    # Most lists need no change, and min and max are fast.
    if values and (min(values) <= 0.0 or max(values) > 1.0):
        return [_clamp(value) for value in values]
    return values


def _not_negative(value: float) -> float:
    return max(value, 0.0) + 0.0


_NearProbability = Annotated[
    FiniteFloat, Field(ge=-ROUND_OFF, le=1 + ROUND_OFF, json_schema_extra={"minimum": 0, "maximum": 1})
]
Printable = AfterValidator(printable)
"""Text of a message reaches terminals and logs, where no character of a stranger may control anything."""
ShortText = Annotated[str, AfterValidator(lambda text: text[:TEXT_LIMIT]), Printable]
Id = Annotated[str, Field(max_length=ID_LIMIT), Printable]
Label = Annotated[str, Field(max_length=LABEL_LIMIT), Printable]
"""The label of a movement, or "" where there is none."""
Identifier = Annotated[str, Field(pattern=r"^[a-z0-9_-]{1,64}$")]
Count = Annotated[int, Field(ge=0, le=LAST_INTEGER)]
Time = Annotated[int, Field(ge=0, le=LAST_INTEGER)]
Probability = Annotated[_NearProbability, AfterValidator(_clamp)]
Probabilities = Annotated[list[_NearProbability], AfterValidator(_clamp_all)]
Bits = Annotated[FiniteFloat, Field(ge=-ROUND_OFF, json_schema_extra={"minimum": 0}), AfterValidator(_not_negative)]
Seconds = Annotated[FiniteFloat, Field(gt=0, le=86_400)]
Repetitions = Annotated[FiniteFloat, Field(ge=0)]
"""Periods of a periodic movement; the one in progress counts in part."""
Score = Annotated[FiniteFloat, Field(ge=0, le=10)]
Place = Annotated[list[Annotated[FiniteFloat, Field(ge=-10_000, le=10_000)]], Field(min_length=2, max_length=2)]
"""x and z on the floor, m."""
Roots = list[Annotated[int, Field(ge=0, le=ROOT_LIMIT)]]
"""A distribution in one byte for each value, two for those over .25 (`common.probability.roots_of`)."""


def p_of_roots(roots: Sequence[int]) -> list[float]:
    """The distribution that `roots` stand for, which sums to 1; raises ValueError if all of them are 0."""
    squares = [root * root for root in roots]
    total = sum(squares)
    if not total:
        raise ValueError("root_p has no value above 0")
    return [square / total for square in squares]


class MessagePart(BaseModel):
    """A part of a message, or a whole one. Immutable; unknown fields are ignored."""

    model_config = ConfigDict(frozen=True, extra="ignore")


def require_table(surprise: Sequence[Sequence[int]]) -> None:
    """Raises ValueError unless the rows of a facing have one length, 1 to FACINGS_LIMIT."""
    if len({len(row) for row in surprise}) != 1 or not 1 <= len(surprise[0]) <= FACINGS_LIMIT:
        raise ValueError(f"surprise has rows of different lengths, or not 1 to {FACINGS_LIMIT} facings")


class VotedRepeated(MessagePart):
    """More about a vote's repetitions: how many are partial, and their swing in body sizes."""

    partial: Repetitions = 0.0
    swing: Annotated[FiniteFloat, Field(ge=0)] = 0.0


class VotedFacing(MessagePart):
    """The facing of an observer's posterior (common/posterior.py), in its vote."""

    surprise: list[list[Annotated[int, Field(ge=0, le=SURPRISE_LIMIT)]]] = Field(min_length=2, max_length=LABELS_LIMIT)

    @model_validator(mode="after")
    def _is_table(self) -> "VotedFacing":
        require_table(self.surprise)
        return self


PAUSE_S = 0.4
"""A longer rest ends a movement whose `rest_s` is not known: people rest for longer between two, or not at all."""
LONGEST_STAY = 2.0
"""Periods. Who turns round so long after the last time begins anew; turns are half a period apart, and some people of
ui_prmd hold an exercise for more than one."""


class MovementTimes(MessagePart):
    """What the takes of a movement say about its durations in seconds; None: not known.

    shortest_s: of its shortest take. rest_s: the shortest rest between two takes. period_s: if its takes are periodic.
    """

    shortest_s: Seconds | None = None
    rest_s: Seconds | None = None
    period_s: Seconds | None = None


class BodyRegionShares(MessagePart):
    """How much an observer's model leans on each of R regions of the body to recognise each of M movements.

    `hash` is that of its vocabulary. shares: (M, R), percent; 0 for a region with little.
    """

    hash: Id
    regions: list[ShortText] = Field(min_length=1, max_length=PARTS_LIMIT)
    shares: list[list[Annotated[int, Field(ge=0, le=100)]]] = Field(min_length=2, max_length=LABELS_LIMIT)

    @model_validator(mode="after")
    def _is_table(self) -> "BodyRegionShares":
        if {len(row) for row in self.shares} != {len(self.regions)}:
            raise ValueError(f"shares has rows of other lengths than {len(self.regions)}, one for each region")
        return self


P = TypeVar("P", bound=MessagePart)
_DICT, _FIELDS_SET, _EXTRA, _PRIVATE = (
    vars(BaseModel)[name].__set__
    for name in ("__dict__", "__pydantic_fields_set__", "__pydantic_extra__", "__pydantic_private__")
)
"""The slots of a pydantic model, which is frozen otherwise."""


def unchecked(kind: type[P], fields: dict[str, Any]) -> P:
    """The message of type `kind` with `fields`, all of them and in range; in a tenth of the time of validation.

    The same as `kind.model_construct`, which looks each field up.
    """
    message = kind.__new__(kind)
    _DICT(message, fields)
    _FIELDS_SET(message, _field_names(kind))
    _EXTRA(message, None)
    _PRIVATE(message, None)
    return message


@cache
def _field_names(kind: type[MessagePart]) -> set[str]:
    """One set for all messages of a type: pydantic copies it for a message that differs."""
    return set(kind.model_fields)
