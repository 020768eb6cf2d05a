"""How well a movement was done: what one observer says, and a remark in words. Pure.

The scores themselves: docs/design/score.md.
"""

import math
from typing import Annotated

from msgspec import Meta, Struct
from msgspec.structs import force_setattr, replace

from common.message_types import LABEL_LIMIT, LAST_INTEGER
from common.text import printable

BEST_SCORE = 10.0
REMARKS_LIMIT = 3
"""Remarks on one performance: people remember no more."""
REMARK_LIMIT = 120
"""Characters of a remark in words."""
Joint = Annotated[str, Meta(max_length=LABEL_LIMIT)]


class ObservedRemark(Struct, frozen=True, kw_only=True, gc=False):
    """What one observer remarks: a joint, the moment, 0 begin to 1 end, and by how many degrees it is too straight,
    or, below 0, too bent. strength: 1 is what is just worth a remark."""

    joint: Joint
    moment: Annotated[float, Meta(ge=0, le=1)]
    degrees: Annotated[float, Meta(ge=-360, le=360)]
    strength: Annotated[float, Meta(ge=0)] = 1.0

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (self.moment, self.degrees, self.strength))):
            raise ValueError("a remark has a value that is not finite")
        if not self.joint.isprintable():
            force_setattr(self, "joint", printable(self.joint))

    @property
    def words(self) -> str:
        """For people."""
        return remark_words(self.joint, self.degrees, self.moment)


class ObservedScore(Struct, frozen=True, kw_only=True, gc=False):
    """One observer's score of the movement that ended at `ended_ns`, 0 to 10, if it was `label`.

    certainty: share of the limbs that it saw, 0 to 1.
    """

    label: Joint
    ended_ns: Annotated[int, Meta(ge=0, le=LAST_INTEGER)]
    score: Annotated[float, Meta(ge=0, le=BEST_SCORE)]
    certainty: Annotated[float, Meta(ge=0, le=1)] = 1.0
    remarks: Annotated[list[ObservedRemark], Meta(max_length=REMARKS_LIMIT)] = []

    def __post_init__(self) -> None:
        if not (math.isfinite(self.score) and math.isfinite(self.certainty)):
            raise ValueError("score has a value that is not finite")
        if not self.label.isprintable():
            force_setattr(self, "label", printable(self.label))

    def shifted(self, by_ns: int) -> "ObservedScore":
        """The same by a clock that is so far ahead."""
        return replace(self, ended_ns=self.ended_ns + by_ns)


def remark_words(joint: str, degrees: float, moment: float) -> str:
    """`left knee: 12 degrees too straight at 60 %`."""
    direction = "straight" if degrees > 0 else "bent"
    return f"{joint}: {abs(degrees):.0f} degrees too {direction} at {moment:.0%}".replace("%", " %")
