"""Features of motion in the image: Laban's Space as Vector Symbols (section III.A, (1)), and posture. Pure.

Vector Symbols discard position and magnitude; posture, the place and motion of each body part relative to the body,
keeps both, still relative to the performer's size (docs/design/model.md).
"""

import math
from collections.abc import Sequence
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.body import TORSO_SHARE, BodyFrame
from observer.tracks import Floats, Tracks

Symbols = NDArray[np.int8]


class VectorSymbol(IntEnum):
    """The nine values of B in the order of (1), clockwise from up: R is image right, U is image up.

    NOT_SEEN is none of the nine: the motion is unknown, so that all nine are equally likely. O is seen to be
    still.
    """

    NOT_SEEN = -1
    O = 0  # noqa: E741 - the paper's letter
    U = 1
    UR = 2
    R = 3
    DR = 4
    D = 5
    DL = 6
    L = 7
    UL = 8


def vector_symbols(displacements: Floats, size: float, threshold: float) -> Symbols:
    """(..., 2) displacements in the image, v down -> (...) int8 symbols (section III.A).

    Bins of 45° centred on the axes. Displacements shorter than threshold * size are O; size: the body's, in the
    displacements' unit. NOT_SEEN where a displacement is NaN, and everywhere while the size is NaN (not known yet).
    """
    finite: NDArray[np.bool_] = np.isfinite(displacements)
    known = np.logical_and.reduce(finite, axis=-1, keepdims=True) & math.isfinite(size)
    du, dv = np.moveaxis(np.where(known, displacements, 0.0), -1, 0)
    length = np.hypot(du, dv)
    # Without the second condition a threshold of 0 would give stillness a direction.
    still = (length < threshold * size) | (length == 0)
    eighths_from_up = np.rint(np.arctan2(du, -dv) / (math.pi / 4)) % 8
    moved = np.where(still, VectorSymbol.O, VectorSymbol.U + eighths_from_up)
    return np.where(known[..., 0], moved, VectorSymbol.NOT_SEEN).astype(np.int8)


class BodySize:
    """The performer's size in the image: TORSO_SHARE of the largest distance so far between head and a visible hand."""

    def __init__(self) -> None:
        self._largest = 0.0

    def update(self, centres: Floats, body_parts: Sequence[str]) -> float:
        """(P, 2) centres (NaN: not seen) and the names of the P parts -> size in the same unit; NaN until known.

        Raises BadInput if there is no head or no hand among the names.
        """
        head, hands = _head_and_hands(body_parts)
        distances = np.linalg.norm(centres[hands] - centres[head], axis=1)
        self._largest = max(self._largest, float(np.nanmax(distances, initial=0.0)))
        return TORSO_SHARE * self._largest if self._largest > 0 else math.nan


class SpaceReader:
    """Reads Space from a stream of tracks: one Vector Symbol per body part and frame.

    body_parts: names of the P parts. threshold: shortest motion that counts as one, as a share of the performer's
    size; it depends on the frame rate and is fitted on training subjects.
    """

    def __init__(self, body_parts: Sequence[str], threshold: float) -> None:
        self._body_parts = tuple(body_parts)
        self._threshold = threshold
        self._size = BodySize()
        self._last: Floats | None = None

    def update(self, tracks: Tracks) -> Symbols:
        """(P,) symbols of the motion since the frame before; NOT_SEEN for a part that was missing now or then.

        All are NOT_SEEN in the first frame, and until a hand was seen together with the head.
        """
        size = self._size.update(tracks.centres, self._body_parts)
        displacements = tracks.centres - (np.nan if self._last is None else self._last)
        self._last = tracks.centres.copy()
        return vector_symbols(displacements, size, self._threshold)


def _head_and_hands(body_parts: Sequence[str]) -> tuple[int, list[int]]:
    hands = [row for row, part in enumerate(body_parts) if part in ("left_hand", "right_hand")]
    if "head" not in body_parts or not hands:
        raise BadInput(f"body_parts = {list(body_parts)}: the size needs a head and a left_hand or right_hand")
    return body_parts.index("head"), hands


FEATURES_PER_PART = 5
"""Position right and up, direction right and up, speed."""
HANDS_FEATURES = 2
"""At the end: from the right hand to the left one, right and up."""
REFERENCE_HZ = 15.0
"""Speeds are per 1/15 s, whatever the frame rate: the constants below were chosen at 15 Hz."""
SLOW_DIRECTION = 0.1
"""Below this speed (body sizes per 1/15 s) the direction fades out, so that tracker noise has none."""


class PostureReader:
    """Reads posture from a stream of tracks, from past frames only.

    body_parts: names of the P parts, at least two. max_speed: the largest speed that counts, in body sizes per 1/15 s,
    and the length of a full direction; it sets the weight of motion relative to position. hands_weight: weight of the
    distance between the hands relative to their positions, as an exponent of its evidence. parts: the names of those
    that are read, in the order of body_parts; None: all. Raises BadInput for a single part.
    """

    def __init__(
        self,
        body_parts: Sequence[str],
        rate_hz: float,
        max_speed: float,
        hands_weight: float = 0.0,
        parts: Sequence[str] | None = None,
    ) -> None:
        self._hands_scale = math.sqrt(hands_weight)
        parts = body_parts if parts is None else parts
        self._rows = np.array([list(body_parts).index(part) for part in parts])
        hands = ("left_hand", "right_hand")
        self._hands = [list(parts).index(hand) for hand in hands if hand in parts]
        self._rate_hz, self._max_speed = rate_hz, max_speed
        self._frame = BodyFrame(body_parts, rate_hz)
        self._last: Floats = np.full((len(parts), 2), np.nan)

    @property
    def still(self) -> float:
        """P(the person is still) in the newest frame."""
        return self._frame.still

    def update(self, tracks: Tracks) -> Floats:
        """(P * 5 + 2,) features of the P parts that are read, in body sizes; NaN for a part not seen, now or, for
        motion, in the previous frame.

        In the first frame all features of motion are NaN.
        """
        return self.read(tracks, *self._frame.update(tracks))

    def read(self, tracks: Tracks, origin: Floats, size: float) -> Floats:
        """As `update`, with the origin (2,) and the size of a body frame that the caller has updated."""
        centres = tracks.centres[self._rows]
        features = np.full(FEATURES_PER_PART * len(centres) + HANDS_FEATURES, np.nan)
        of_parts = features[:-HANDS_FEATURES].reshape(-1, FEATURES_PER_PART)
        scale = UP / size
        of_parts[:, :2] = (centres - origin) * scale
        velocity = (centres - self._last) * (scale * (self._rate_hz / REFERENCE_HZ))
        self._last = centres
        of_parts[:, 2:] = soft_direction(velocity, self._max_speed)
        if len(self._hands) == 2:
            left, right = self._hands
            features[-HANDS_FEATURES:] = (of_parts[left, :2] - of_parts[right, :2]) * self._hands_scale
        return features


UP = np.array([1.0, -1.0])
"""Image coordinates, v down -> up is positive."""


def soft_direction(velocity: Floats, max_speed: float) -> Floats:
    """(P, 2) velocities -> (P, 3): direction v/max(|v|, SLOW_DIRECTION) * max_speed, and speed min(|v|, max_speed)."""
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    soft = np.empty((len(velocity), 3))
    soft[:, :2] = velocity * (max_speed / np.maximum(speed, SLOW_DIRECTION))[:, None]
    soft[:, 2] = np.minimum(speed, max_speed)
    return soft


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
