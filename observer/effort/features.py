"""Features of Effort in one image plane, from the course of a movement so far (docs/design/effort.md). Pure.

Hands and head only. Derivatives are those of Savitzky and Golay, Analytical Chemistry 36 (1964): a polynomial is fitted
by least squares to the frames around an instant. The second and third derivative of unsmoothed positions are mostly
noise. Ratios are logarithmic, so that no person's tempo or size is the unit. The active hand moves more than the other.
"""

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from observer.features import BodySize
from observer.tracks import Floats

DEGREE = 3
"""The lowest degree that has a third derivative."""
STROKE_WINDOW_S = 0.23
"""Seven frames at 30 Hz: shorter than a stroke of a hand, longer than the jitter of a tracker."""
SHORTEST_WINDOW = 5
"""Frames: a polynomial of DEGREE needs 4, and a middle."""
LONGEST_MEASURED_S = 20.0
"""Of a longer movement only the newest part is kept, so that neither memory nor time grows."""


@lru_cache(maxsize=16)
def coefficients(frames: int, rate_hz: float) -> Floats:
    """(4, frames): rows give position, velocity, acceleration and jerk in the middle of the window, per s, s² and s³.

    k! times row k of the pseudo-inverse of (t^0 t^1 t^2 t^3), t in seconds from the middle.
    """
    t = (np.arange(frames) - (frames - 1) / 2) / rate_hz
    solved, *_ = np.linalg.lstsq(np.vander(t, DEGREE + 1, increasing=True), np.eye(frames), rcond=None)
    rows: Floats = solved * np.array([[float(math.factorial(k))] for k in range(DEGREE + 1)])
    return rows


class Course:
    """Places (T, P, 2), right and up, and their derivatives (T', 3, P, 2): velocity, acceleration, jerk.

    body_parts: names of the P parts. `size` is the performer's, in the image's unit, NaN until known.
    """

    def __init__(self, body_parts: Sequence[str], rate_hz: float) -> None:
        self.body_parts, self.rate_hz = tuple(body_parts), rate_hz
        # The odd number of frames in the window.
        self._width = max(2 * round((STROKE_WINDOW_S * rate_hz - 1) / 2) + 1, SHORTEST_WINDOW)
        self._filter = coefficients(self._width, rate_hz)[1:]
        self._capacity = max(round(LONGEST_MEASURED_S * rate_hz), 4 * self._width)
        self._places = np.empty((self._capacity, len(body_parts), 2))
        self._moves = np.empty((self._capacity, 3, len(body_parts), 2))
        self._body = BodySize()
        self._count = 0
        self.size = float("nan")

    def __len__(self) -> int:
        """Number of frames."""
        return self._count

    def add(self, centres: Floats) -> None:
        """Add one frame: (P, 2) image coordinates, v down, NaN where not seen."""
        self.size = self._body.update(centres, self.body_parts)
        if self._count == self._capacity:
            self._keep(self._capacity // 2)
        self._places[self._count] = centres * (1.0, -1.0)
        self._count += 1
        if self._count >= self._width:
            window = self._places[self._count - self._width : self._count]
            moved = self._filter @ window.reshape(self._width, -1)
            self._moves[self._count - self._width] = moved.reshape(3, -1, 2)

    def begin(self, keep: int) -> None:
        """Start a movement, to which the last `keep` frames belong; the size stays known."""
        if self._count > keep:
            self._keep(keep)

    def _keep(self, frames: int) -> None:
        moves = max(frames - self._width + 1, 0)
        last = self._count - self._width + 1
        self._places[:frames] = self._places[self._count - frames : self._count].copy()
        self._moves[:moves] = self._moves[max(last, 0) - moves : max(last, 0)].copy()
        self._count = frames

    @property
    def places(self) -> Floats:
        """(T, P, 2) in body sizes."""
        return self._places[: self._count] / self.size

    @property
    def moves(self) -> Floats:
        """(T - window + 1, 3, P, 2) in body sizes per s, s² and s³."""
        return self._moves[: max(self._count - self._width + 1, 0)] / self.size


def course_of(tracks: Sequence[Floats] | NDArray[np.float64], body_parts: Sequence[str], rate_hz: float) -> Course:
    """The course of (P, 2) frames, the same as if they were added during the movement."""
    course = Course(body_parts, rate_hz)
    for centres in tracks:
        course.add(centres)
    return course


TEMPO = ("acceleration", "jerk", "bending", "bending_other")
RISE = ("rise_most",)
LEAN = (
    *("lean_median", "lean_most", "lean_least", "lean_last", "rise_median", "rise_most", "rise_least"),
    *("lean_first_quarter", "lean_second_quarter", "lean_third_quarter", "lean_fourth_quarter"),
)
OTHER_HAND = ("other_right", "other_up", "other_share")
WANDER = ("head_turning", "head_quiet_speed", "head_while_hand_quiet", "head_at_last", "head_quiet_jerk")
FEATURE_NAMES = tuple(dict.fromkeys((*TEMPO, *LEAN, *OTHER_HAND, *WANDER)))

LEAST_MOTION = 1e-3
"""Body sizes per s (s², s³): counts as no motion; below it a logarithm would measure rounding."""
LEAST_RATIO = 0.01
"""The same for a ratio of two motions, either of which may be zero."""
SMALL_LEAN = 0.02
"""Share of a body size: smaller leans count linearly, larger ones by their logarithm."""
BEND_S, BEND_LONG_S = 8 / 30, 0.5
"""Path and net displacement are compared over this time: within one stroke, and within two."""
QUIET_PART = 0.25
"""Quantile of a motion that stands for its quiet part."""
FEWEST_FRAMES = 3
"""With derivatives at fewer instants there are no features."""


def features(course: Course) -> Floats:
    """FEATURE_NAMES, in their order; NaN where a part was not seen enough. All NaN without head and hands."""
    values: dict[str, float] = {}
    moves, places = course.moves, course.places
    if len(moves) >= FEWEST_FRAMES and np.isfinite(course.size):
        left, right, head = (course.body_parts.index(part) for part in ("left_hand", "right_hand", "head"))
        lengths = np.sqrt((moves**2).sum(axis=-1))
        mean = {hand: _mean(lengths[:, 0, hand]) for hand in (left, right)}
        # A hand that is never seen is not the active one.
        active, other = (left, right) if np.nan_to_num(mean[left]) > np.nan_to_num(mean[right]) else (right, left)
        values |= _tempo_and_wander(moves[:, :, head], lengths[:, :, active], lengths[:, :, head])
        values["bending"] = _bending(places[:, active] - places[:, head], round(BEND_S * course.rate_hz))
        values["bending_other"] = _bending(places[:, other] - places[:, head], round(BEND_LONG_S * course.rate_hz))
        last = np.diff(places[-max(len(places) // 5, 3) :, head, 0])
        values["head_at_last"] = _log(_mean(np.abs(last)) * course.rate_hz, LEAST_MOTION)
        values |= _lean(places[:, head])
        values |= _other_hand(places[:, other] - places[:, head], mean[other], mean[active])
    return np.array([values.get(name, np.nan) for name in FEATURE_NAMES])


def _tempo_and_wander(head: Floats, hand_lengths: Floats, head_lengths: Floats) -> Mapping[str, float]:
    """How the active hand moves, and how the head moves on its own: turning, or moving while the hand is quiet.

    head: (T, 3, 2) velocity, acceleration, jerk; lengths: (T, 3) theirs, of the hand and of the head.
    """
    velocity, acceleration = head[:, 0], head[:, 1]
    across = np.abs(velocity[:, 0] * acceleration[:, 1] - velocity[:, 1] * acceleration[:, 0])
    columns = np.column_stack([hand_lengths, head_lengths[:, ::2], across / (head_lengths[:, 0] ** 3 + LEAST_RATIO)])
    slow, acceleration_, jerk, head_speed, head_jerk, turning = _quantiles(
        columns, (0.3, 0.5, 0.5, QUIET_PART, QUIET_PART, 0.5)
    )
    aside = np.abs(velocity[hand_lengths[:, 0] <= slow, 0])
    return {
        "acceleration": _log(acceleration_, LEAST_MOTION),
        "jerk": _log(jerk, LEAST_MOTION),
        "head_turning": _log(turning, LEAST_MOTION),
        "head_quiet_speed": _log(head_speed, LEAST_MOTION),
        "head_quiet_jerk": _log(head_jerk, LEAST_MOTION),
        "head_while_hand_quiet": _log(_mean(aside), 2 * LEAST_MOTION) - _log(_mean(hand_lengths[:, 0]), LEAST_RATIO),
    }


def _lean(head: Floats) -> Mapping[str, float]:
    """Displacement of the head since the beginning: to the image's right (lean) and up (rise)."""
    places = head[_whole(head)]
    if len(places) < FEWEST_FRAMES:
        return {}
    moved = places - places[0]
    across = _quantiles(np.repeat(moved, 3, axis=1), 2 * (0.05, 0.5, 0.95))
    values = dict(
        zip((f"{way}_{size}" for way in ("lean", "rise") for size in ("least", "median", "most")), across, strict=True)
    )
    values["lean_last"] = float(moved[-1, 0])
    for k, name in enumerate(("first", "second", "third", "fourth")):
        begin = len(moved) * k // 4
        lean = float(moved[begin : max(len(moved) * (k + 1) // 4, begin + 1), 0].mean())
        values[f"lean_{name}_quarter"] = float(np.sign(lean) * np.log1p(abs(lean) / SMALL_LEAN))
    return values


def _other_hand(against: Floats, other: float, active: float) -> Mapping[str, float]:
    """Place of the other hand relative to the head, and its share in the motion."""
    return {
        "other_right": _mean(against[:, 0]),
        "other_up": _mean(against[:, 1]),
        "other_share": _log(other, LEAST_RATIO) - _log(active, LEAST_RATIO),
    }


def _bending(way: Floats, frames: int) -> float:
    """ln of path over net displacement, summed over all windows of so many frames, or over the whole if shorter."""
    way = way[_whole(way)]
    frames = min(frames, len(way) - 1)
    if frames < 1:
        return math.nan
    path = np.concatenate([[0.0], np.sqrt((np.diff(way, axis=0) ** 2).sum(axis=1)).cumsum()])
    net = np.sqrt(((way[frames:] - way[:-frames]) ** 2).sum(axis=1)).sum()
    return _log((path[frames:] - path[:-frames]).sum(), LEAST_RATIO) - _log(net, LEAST_RATIO)


def _whole(rows: Floats) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    return np.asarray(np.isfinite(rows).all(axis=-1))


def _quantiles(columns: Floats, at: Sequence[float]) -> list[float]:
    """(T, C) and C quantiles -> that quantile of each column without NaN, linear between two instants."""
    # np.sort puts NaN at the end.
    ordered, count = np.sort(columns, axis=0), np.isfinite(columns).sum(axis=0)
    place = np.array(at) * np.maximum(count - 1, 0)
    below = place.astype(int)
    above, every, share = np.minimum(below + 1, np.maximum(count - 1, 0)), np.arange(columns.shape[1]), place - below
    mixed = ordered[below, every] * (1 - share) + ordered[above, every] * share
    quantiles: list[float] = np.where(count >= FEWEST_FRAMES, mixed, np.nan).tolist()
    return quantiles


def _mean(values: Floats) -> float:
    values = values[np.isfinite(values)]
    return float(values.sum()) / len(values) if len(values) else math.nan


def _log(value: float, least: float) -> float:
    return math.log(value + least)
