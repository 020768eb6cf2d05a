"""What an observer sees and believes at one frame, for display; pure."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from common.probability import entropy_bits
from observer.tracks import Floats, Tracks

if TYPE_CHECKING:
    from observer.tracking.skin import SkinHistogram

Picture = NDArray[np.uint8]
"""(H, W, 3) in the order blue, green, red, 0 to 255, or (H, W) grey."""

MOTION_MARGIN = 0.15
"""Margin about recorded motion, as a share of the person's extent."""


@dataclass(frozen=True, slots=True, eq=False)
class ShownPosterior:
    """labels: names of the M movements. p: (M,) posterior over them. rest: probability that the person is at rest."""

    labels: tuple[str, ...]
    p: Floats
    rest: float

    @property
    def entropy_bits(self) -> float:
        """Entropy of p, 0 to log2 M bits."""
        return float(entropy_bits(self.p))

    @property
    def winner(self) -> int | None:
        """Index of the most probable movement; None for a tie."""
        best = int(np.argmax(self.p))
        return best if int((self.p == self.p[best]).sum()) == 1 else None

    def most_probable(self, count: int) -> list[int]:
        """Indices of the `count` most probable movements, in the order of the vocabulary."""
        best = np.argsort(-self.p, kind="stable")[:count]
        return sorted(int(i) for i in best)


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """One frame as an observer saw it. picture: None for motion without pictures, which `extent` places (2, 2).

    tracks: of `body_parts`, in px of the picture or in any unit without one. captured_ns: of the frame. posterior: None
    if there is none. complaint: what is wrong, in words; "" when nothing is. skin: the colour of the person's skin, of
    a tracker that knows it.
    """

    picture: Picture | None
    tracks: Tracks
    body_parts: Sequence[str]
    captured_ns: int
    extent: Floats | None = None
    posterior: ShownPosterior | None = None
    complaint: str = ""
    skin: "SkinHistogram | None" = None


class MotionExtent:
    """The extent of all motion so far; it never shrinks, so that the scale of the picture stays steady.

    corners: (2, 2); None before any motion was seen.
    """

    def __init__(self) -> None:
        self._person_size = 0.0
        self.corners: Floats | None = None

    def widen(self, centres: Floats) -> None:
        """Take in (P, 2) centres, NaN where not seen."""
        seen = centres[np.isfinite(centres).all(axis=1)]
        if not len(seen):
            return
        self._person_size = max(self._person_size, float(np.linalg.norm(seen[:, None] - seen[None], axis=-1).max()))
        margin = MOTION_MARGIN * self._person_size
        corners = np.array([seen.min(axis=0) - margin, seen.max(axis=0) + margin])
        if self.corners is not None:
            corners = np.array([np.minimum(corners[0], self.corners[0]), np.maximum(corners[1], self.corners[1])])
        self.corners = corners
