"""Posture: the place and motion of each body part relative to the body, as soft features (docs/design/model.md).

Vector Symbols discard position and magnitude; these features keep both, still relative to the performer's size.
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
HANDS_FEATURES = 2
"""At the end: from the right hand to the left one, right and up."""
REFERENCE_HZ = 15.0
"""Speeds are per 1/15 s, whatever the frame rate: the constants below were chosen at 15 Hz."""
SLOW = 0.1
"""Below this speed (body sizes per 1/15 s) the direction fades out, so that tracker noise has none."""
ANCHOR_S = 10.0
"""Time constant of the origin of positions: it follows a person who walks, but not one who bends."""


class PostureReader:
    """Reads posture from a stream of tracks, from past frames only.

    body_parts: names of the P parts. max_speed: the largest speed that counts, in body sizes per 1/15 s, and the length
    of a full direction; it sets the weight of motion relative to position. hands_weight: weight of the distance between
    the hands relative to their positions, as an exponent of its evidence. Raises BadInput if the head, the origin of
    positions, is not among the parts.
    """

    def __init__(self, body_parts: Sequence[str], rate_hz: float, max_speed: float, hands_weight: float = 0.0) -> None:
        self._body_parts = tuple(body_parts)
        self._hands_scale = math.sqrt(hands_weight)
        hands = ("left_hand", "right_hand")
        self._hands = [self._body_parts.index(hand) for hand in hands if hand in self._body_parts]
        if "head" not in self._body_parts:
            raise BadInput(f"body_parts = {list(body_parts)}: posture is relative to the head; add head")
        self._head = self._body_parts.index("head")
        self._rate_hz, self._max_speed = rate_hz, max_speed
        self._size = BodySize()
        self._anchor: Floats | None = None
        self._last: Floats = np.full((len(self._body_parts), 2), np.nan)

    def update(self, tracks: Tracks) -> Floats:
        """(P * 5 + 2,) features in body sizes; NaN for a part not seen, now or, for motion, in the previous frame.

        In the first frame all features of motion are NaN.
        """
        size = self._size.update(tracks.centres, self._body_parts)
        centres = tracks.centres * (1.0, -1.0)
        self._follow(centres[self._head])
        anchor = np.full(2, np.nan) if self._anchor is None else self._anchor
        velocity = (centres - self._last) / size * (self._rate_hz / REFERENCE_HZ)
        self._last = centres
        of_parts = np.hstack([(centres - anchor) / size, soft_direction(velocity, self._max_speed)])
        left, right = centres[self._hands] if len(self._hands) == 2 else np.full((2, 2), np.nan)
        return np.concatenate([of_parts.ravel(), (left - right) / size * self._hands_scale])

    def _follow(self, head: Floats) -> None:
        if not np.isfinite(head).all():
            return
        if self._anchor is None:
            self._anchor = head.copy()
        else:
            self._anchor += (head - self._anchor) / (ANCHOR_S * self._rate_hz)


def soft_direction(velocity: Floats, max_speed: float) -> Floats:
    """(P, 2) velocities -> (P, 3): direction v/max(|v|, SLOW) * max_speed, and speed min(|v|, max_speed)."""
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    return np.hstack([velocity / np.maximum(speed, SLOW) * max_speed, np.minimum(speed, max_speed)])


def without_motion(features: NDArray[np.floating]) -> Floats:
    """(..., P * 5 + 2) -> the same postures without motion."""
    still = np.array(features, dtype=np.float64)
    of_parts = still[..., :-HANDS_FEATURES].reshape(*features.shape[:-1], -1, FEATURES_PER_PART)
    of_parts[..., 2:] = 0.0
    still[..., :-HANDS_FEATURES] = of_parts.reshape(*features.shape[:-1], -1)
    return still


def groups_of(body_parts: int) -> NDArray[np.int64]:
    """(P * 5 + 2,) group of each feature; a group is seen or not seen as a whole: 2 per part, and one for the hands."""
    parts = np.repeat(np.arange(2 * body_parts), [2, 3] * body_parts)
    return np.concatenate([parts, np.full(HANDS_FEATURES, 2 * body_parts)])
