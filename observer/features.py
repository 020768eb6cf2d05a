"""Features of motion in the image: a frame's posture, and the trace of the body from frame to frame. Pure.

Posture is the place and motion of each body part relative to the body, in body sizes (docs/design/model.md). A trace
has for each frame the parts' positions relative to the body, and the body's path: it does not depend on where the
person stands. A part that is not seen keeps its last values in it.
"""

import math
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.body import TORSO_SHARE, BodyFrame
from observer.tracks import Floats, Floats32, Integers, Tracks


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


FASTEST_PER_S = 40.0
"""Body sizes: a faster part is an error of the tracker, unless it stays there."""
LONGEST_JUMP = 2
"""Frames for which a jump counts as an error."""
LONGEST_UNSEEN_S = 0.3
"""A part that was unseen for longer has not moved in between: it may be another person's."""


class BodyTrace:
    """Turns a stream of tracks into the rows of a trace; body_parts: names of the P parts.

    usual: (2 P,) where the parts are usually, relative to the body: a part that was never seen counts as there.
    """

    def __init__(self, body_parts: Sequence[str], rate_hz: float, usual: Floats32 | None = None) -> None:
        self.frame = BodyFrame(body_parts, rate_hz)
        self._limit = FASTEST_PER_S / rate_hz
        self._bridge = LONGEST_UNSEEN_S * rate_hz
        parts = len(body_parts)
        # The last point is the body's anchor.
        self._last: Floats = np.full((parts + 1, 2), np.nan)
        self._unseen: Integers = np.zeros(parts + 1, np.int64)
        self._relative: Floats = np.zeros((parts, 2)) if usual is None else usual.reshape(parts, 2).astype(np.float64)
        self._path: Floats = np.zeros(2)
        self._size = 1.0

    def update(self, tracks: Tracks) -> Floats32:
        """Tracks (P, 2) of one frame -> (2 P + 3,) row of the trace, body sizes, right and up.

        2 P: each part's position from the body's anchor. 2: the anchor's path since the first frame. 1: the body's size
        in the image, in the tracks' unit.
        """
        _, size = self.frame.update(tracks)
        if np.isfinite(size) and size > 0:
            self._size = size
            # The body frame holds its anchor while nobody is seen; a held place is no sight of the body.
            anchor = self.frame.anchor if self.frame.seen else np.full(2, np.nan)
            points = np.concatenate([tracks.centres, anchor[None]]) * UP
            self._follow(points, size)
        return np.concatenate([self._relative.ravel(), self._path, [self._size]], dtype=np.float32)

    def _follow(self, points: Floats, size: float) -> None:
        step = (points - self._last) / size
        unseen = self._unseen
        jump = np.hypot(step[:, 0], step[:, 1]) > self._limit * (1 + unseen)
        visible = np.isfinite(points) & ~(jump & (unseen < LONGEST_JUMP))[:, None]
        if visible[-1, 0]:
            if np.isfinite(step[-1, 0]) and unseen[-1] <= self._bridge and not jump[-1]:
                self._path += step[-1]
            np.copyto(self._relative, (points[:-1] - points[-1]) / size, where=visible[:-1])
        np.copyto(self._last, points, where=visible)
        unseen += 1
        unseen[visible[:, 0]] = 0


def read_trace(body_parts: Sequence[str], rate_hz: float, tracks: Iterable[Tracks]) -> Floats32:
    """(F, 2 P + 3) rows of a whole recording."""
    trace = BodyTrace(body_parts, rate_hz)
    return np.array([trace.update(frame) for frame in tracks], np.float32)


def tracks_of(rows: Floats) -> list[Tracks]:
    """(F, 2 P + 3) trace -> tracks (P, 2) with this trace: elsewhere in the image, and parts that were unseen for a
    while at their last place. Nothing is seen before the first sight of the body."""
    relative, path, size = rows[:, :-3].reshape(len(rows), -1, 2), rows[:, -3:-1], rows[:, -1:]
    anchor = np.cumsum(np.diff(path, axis=0, prepend=path[:1]) * size, axis=0)
    centres = (anchor[:, None] + relative * size[:, None]) * (1.0, -1.0)
    centres[~np.logical_or.accumulate(relative.any(axis=(1, 2)))] = np.nan
    return [Tracks(each) for each in centres]


def hop_of(rate_hz: float) -> int:
    """Frames from one that is judged, compared or learned from to the next: there are about 15 a second."""
    return max(round(rate_hz / REFERENCE_HZ), 1)


def width_of(parts: int) -> int:
    """The number of columns of a trace of P parts."""
    return 2 * parts + 3


def places_and_differences(parts: int) -> Floats32:
    """(S, 2 P) matrix whose rows are each coordinate of each of P parts, then the differences of every two parts.

    A difference of two parts shows the posture, however the body moves.
    """
    points = np.eye(2 * parts, dtype=np.float32).reshape(parts, 2, -1)
    return np.concatenate([*points, *(points[i] - points[k] for i in range(parts) for k in range(i))])


FloatT = TypeVar("FloatT", np.float32, np.float64)


def resampled(values: NDArray[FloatT], length: int) -> NDArray[FloatT]:
    """(F, C) -> (length, C) at instants evenly from the first frame to the last, linear between frames."""
    before, after, later = _between_frames(len(values), length)
    share: NDArray[FloatT] = later.astype(values.dtype)
    return values[before] * (1 - share) + values[after] * share


@lru_cache(maxsize=256)
def _between_frames(frames: int, length: int) -> tuple[Integers, Integers, Floats]:
    """(length,) frames before and after each of `length` instants, and (length, 1) the share of the later one."""
    place = np.linspace(0, frames - 1, length)
    before = place.astype(np.int64)
    return before, np.minimum(before + 1, frames - 1), (place - before)[:, None]


def relative_and_path(rows: Floats32) -> tuple[Floats32, Floats32]:
    """(F, 2 P + 3) -> (F, 2 P) positions relative to the body, (F, 2 P) paths of the parts in the image."""
    relative = rows[:, :-3]
    path: Floats32 = relative + np.tile(rows[:, -3:-1], relative.shape[1] // 2)
    return relative, path


EXTENT_S = 2.0
"""How far back `extent` looks."""


def extent(rows: Floats32, rate_hz: float) -> float:
    """The largest extent of a part within the last EXTENT_S, body sizes: the diagonal of its bounding box.

    rows: (F, 2 P + 3) trace. Positions are relative to the body's anchor, except that its path up and down counts:
    people who stand shift their weight sideways.
    """
    recent = rows[-max(round(EXTENT_S * rate_hz), 2) :]
    places = recent[:, :-3].copy()
    places[:, 1::2] += recent[:, -2:-1]
    sides = np.maximum.reduce(places) - np.minimum.reduce(places)
    return float(np.maximum.reduce(np.hypot(sides[::2], sides[1::2])))
