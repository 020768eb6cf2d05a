"""The course of one movement so far: where the parts were and how they moved, kept frame by frame. Pure."""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from observer.features.space import BodySize
from observer.tracks import Floats

LONGEST_S = 20.0
"""A movement that goes on for longer is judged by its newest part, so that neither memory nor time grows."""


class Course:
    """Places (T, P, 2), right and up, and their derivatives (T', 3, P, 2): velocity, acceleration, jerk.

    body_parts: names of the P parts. `size` is the performer's, in the image's unit, NaN until known.
    """

    def __init__(self, body_parts: Sequence[str], rate_hz: float) -> None:
        self.body_parts, self.rate_hz = tuple(body_parts), rate_hz
        self._width = window_frames(rate_hz)
        self._filter = coefficients(self._width, rate_hz)[1:]
        self._most = max(round(LONGEST_S * rate_hz), 4 * self._width)
        self._places = np.empty((self._most, len(body_parts), 2))
        self._moves = np.empty((self._most, 3, len(body_parts), 2))
        self._body = BodySize()
        self._count = 0
        self.size = float("nan")

    def __len__(self) -> int:
        """How many frames are in it."""
        return self._count

    def add(self, centres: Floats) -> None:
        """One frame: (P, 2) image coordinates, v down, NaN where not seen."""
        self.size = self._body.update(centres, self.body_parts)
        if self._count == self._most:
            self._keep(self._most // 2)
        self._places[self._count] = centres * (1.0, -1.0)
        self._count += 1
        if self._count >= self._width:
            window = self._places[self._count - self._width : self._count]
            moved = self._filter @ window.reshape(self._width, -1)
            self._moves[self._count - self._width] = moved.reshape(3, -1, 2)

    def begin(self, keep: int) -> None:
        """A movement begins now; of what was before, the last `keep` frames belong to it. The size stays known."""
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
    """A whole movement of (P, 2) frames, read as it would be read while it goes on."""
    course = Course(body_parts, rate_hz)
    for centres in tracks:
        course.add(centres)
    return course


DEGREE = 3
"""The lowest degree that has a third derivative."""
WINDOW_S = 0.23
"""Seven frames at 30 Hz: shorter than a stroke of a hand, longer than the trembling of a tracker."""
FEWEST_FRAMES = 5


def window_frames(rate_hz: float) -> int:
    """The odd number of frames that WINDOW_S holds at this rate, at least FEWEST_FRAMES."""
    return max(2 * round((WINDOW_S * rate_hz - 1) / 2) + 1, FEWEST_FRAMES)


@lru_cache(maxsize=16)
def coefficients(frames: int, rate_hz: float) -> Floats:
    """(4, frames): the rows give position, velocity, acceleration and jerk in the middle of so many frames.

    k! times row k of the pseudo-inverse of (t^0 t^1 t^2 t^3), t in seconds from the middle. Per second, per s², per s³.
    """
    t = (np.arange(frames) - (frames - 1) / 2) / rate_hz
    solved, *_ = np.linalg.lstsq(np.vander(t, DEGREE + 1, increasing=True), np.eye(frames), rcond=None)
    rows: Floats = solved * np.array([[float(math.factorial(k))] for k in range(DEGREE + 1)])
    return rows


def derivatives(tracks: Floats, rate_hz: float, frames: int | None = None) -> Floats:
    """(T, P, D) tracks -> (4, T - frames + 1, P, D): position, velocity, acceleration, jerk in each middle.

    A part that is not seen (NaN) in one frame of a window has no derivative there: NaN.
    """
    width = frames or window_frames(rate_hz)
    if len(tracks) < width:
        return np.empty((DEGREE + 1, 0, *tracks.shape[1:]))
    windows = np.lib.stride_tricks.sliding_window_view(tracks, width, axis=0)
    found: Floats = np.moveaxis(windows @ coefficients(width, rate_hz).T, -1, 0)
    return found
