"""What an observer sees in one frame: where each body part is in its image, if it is seen at all."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

BODY_PARTS = ("left_hand", "right_hand", "head")
"""The paper's three: lh, rh and face (section V.A), in the order of every per-part array."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One picture, or here one instant of recorded motion: `content` is whatever the tracker understands.

    captured_ns: Unix epoch, stamped at capture. content: (P, 3) positions in metres for recorded motion, (H, W, 3)
    uint8 in the order blue, green, red for a picture.
    """

    captured_ns: int
    content: NDArray[Any]


@dataclass(frozen=True, slots=True)
class Tracks:
    """centres: (P, 2) image coordinates, u to the right, v DOWN, any unit; a row of NaN is a part not seen."""

    centres: Floats

    @property
    def visible(self) -> NDArray[np.bool_]:
        """(P,) whether each part is seen."""
        seen: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(self.centres), axis=1)
        return seen


class Tracker(Protocol):
    """Finds the body parts in a frame."""

    @property
    def body_parts(self) -> Sequence[str]:
        """Names of the P parts, in the order of the rows of `Tracks.centres`."""

    def update(self, frame: Frame) -> Tracks:
        """The tracks in the newest frame; may remember earlier ones."""
