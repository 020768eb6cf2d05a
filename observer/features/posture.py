"""Posture: where each body part is relative to the body, and how it moves, as soft features (docs/design/model.md).

Vector Symbols throw position and magnitude away; these features keep both, still relative to the performer's size.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.features.space import BodySize
from observer.tracks import Floats, Tracks

FEATURES_PER_PART = 5
"""Position right and up, direction right and up, speed."""
APART = 2
"""Two more at the end: from the right hand to the left one, right and up."""
REFERENCE_HZ = 15.0
"""Speeds are per fifteenth of a second, whatever the frame rate: the constants below were found at 15 Hz."""
SLOW = 0.1
"""Below this speed (body sizes per 1/15 s) the direction fades out, so that tracker noise has none."""
ANCHOR_S = 10.0
"""Time constant of the place that positions count from: it follows a person who walks, not one who bends."""


class PostureReader:
    """Reads posture from the stream of tracks; only from frames already seen.

    body_parts: names of the P parts. fast: the greatest speed that counts, body sizes per 1/15 s, and the length of a
    full direction: how much motion weighs beside position. apart: how much the hands' distance weighs beside their
    positions, as an exponent of its evidence. Raises BadInput when the head, from which positions count, is not among
    the parts.
    """

    def __init__(self, body_parts: Sequence[str], rate_hz: float, fast: float, apart: float = 0.0) -> None:
        self._body_parts = tuple(body_parts)
        self._apart = math.sqrt(apart)
        hands = ("left_hand", "right_hand")
        self._hands = [self._body_parts.index(hand) for hand in hands if hand in self._body_parts]
        if "head" not in self._body_parts:
            raise BadInput(f"body_parts = {list(body_parts)}: posture is relative to the head; add head")
        self._head = self._body_parts.index("head")
        self._rate_hz, self._fast = rate_hz, fast
        self._size = BodySize()
        self._anchor: Floats | None = None
        self._last: Floats = np.full((len(self._body_parts), 2), np.nan)

    def update(self, tracks: Tracks) -> Floats:
        """(P * 5 + 2,) features in body sizes; NaN where a part was not seen, now or, for motion, in the frame before.

        In the first frame nothing is known of motion, and all its features are NaN.
        """
        size = self._size.update(tracks.centres, self._body_parts)
        centres = tracks.centres * (1.0, -1.0)
        self._follow(centres[self._head])
        anchor = np.full(2, np.nan) if self._anchor is None else self._anchor
        velocity = (centres - self._last) / size * (self._rate_hz / REFERENCE_HZ)
        self._last = centres
        of_parts = np.hstack([(centres - anchor) / size, soft_direction(velocity, self._fast)])
        left, right = centres[self._hands] if len(self._hands) == 2 else np.full((2, 2), np.nan)
        return np.concatenate([of_parts.ravel(), (left - right) / size * self._apart])

    def _follow(self, head: Floats) -> None:
        if not np.isfinite(head).all():
            return
        if self._anchor is None:
            self._anchor = head.copy()
        else:
            self._anchor += (head - self._anchor) / (ANCHOR_S * self._rate_hz)


def soft_direction(velocity: Floats, fast: float) -> Floats:
    """(P, 2) velocities -> (P, 3): direction v/max(|v|, SLOW) * fast, and speed min(|v|, fast)."""
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    return np.hstack([velocity / np.maximum(speed, SLOW) * fast, np.minimum(speed, fast)])


def at_rest(features: NDArray[np.floating]) -> Floats:
    """(..., P * 5 + 2) -> the same postures without motion."""
    still = np.array(features, dtype=np.float64)
    of_parts = still[..., :-APART].reshape(*features.shape[:-1], -1, FEATURES_PER_PART)
    of_parts[..., 2:] = 0.0
    still[..., :-APART] = of_parts.reshape(*features.shape[:-1], -1)
    return still


def groups_of(body_parts: int) -> NDArray[np.int64]:
    """(P * 5 + 2,) for each feature the number of the group that is seen or not seen as one: 2 a part, and the last."""
    parts = np.repeat(np.arange(2 * body_parts), [2, 3] * body_parts)
    return np.concatenate([parts, np.full(APART, 2 * body_parts)])
