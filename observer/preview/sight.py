"""What an observer sees in one frame, for display; pure."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.tracks import Floats, Tracks

Picture = NDArray[np.uint8]
"""(H, W, 3) in the order blue, green, red, 0 to 255, or (H, W) grey."""

MOTION_MARGIN = 0.15
"""Margin about recorded motion, as a share of the person's extent."""


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """One frame as an observer saw it. picture: None for motion without pictures, which `extent` places (2, 2).

    tracks: of `body_parts`, in px of the picture or in any unit without one. captured_ns: of the frame.
    """

    picture: Picture | None
    tracks: Tracks
    body_parts: Sequence[str]
    captured_ns: int
    extent: Floats | None = None


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
