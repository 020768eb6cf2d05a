"""The types of the fields of messages: numbers with their ranges, and the rounding of probabilities. Pure."""

from typing import Annotated, Final

from pydantic import AfterValidator, Field, FiniteFloat

ROUND_OFF = 1e-6
"""A probability or entropy may be outside its range by this much: more than a softmax in float32 loses."""
TEXT_LIMIT = 200
"""Characters of a text for people; what is over it is cut off."""
ID_LIMIT = 128
"""Characters of what identifies a session, a movement or a vocabulary."""
CONTRADICTED = 0.6
"""An observer that is relied on less than this is contradicted by the others; honest ones of people stay above .85."""
SAME_ID_REASON: Final = "another process has this id"
"""The reason in the status of a fusion service that has noticed a second process of its id."""
LAST_INTEGER: Final = 2**63 - 1


def _clamp(value: float) -> float:
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
ShortText = Annotated[str, AfterValidator(lambda text: text[:TEXT_LIMIT])]
Id = Annotated[str, Field(max_length=ID_LIMIT)]
Identifier = Annotated[str, Field(pattern=r"^[a-z0-9_-]{1,64}$")]
Count = Annotated[int, Field(ge=0, le=LAST_INTEGER)]
Time = Annotated[int, Field(ge=0, le=LAST_INTEGER)]
Probability = Annotated[_NearProbability, AfterValidator(_clamp)]
Probabilities = Annotated[list[_NearProbability], AfterValidator(_clamp_all)]
Bits = Annotated[FiniteFloat, Field(ge=-ROUND_OFF, json_schema_extra={"minimum": 0}), AfterValidator(_not_negative)]
