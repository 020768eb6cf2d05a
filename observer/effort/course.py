"""The course of a movement so far: places of the body parts and their smoothed derivatives, frame by frame. Pure.

Derivatives are those of Savitzky and Golay, Analytical Chemistry 36 (1964): a polynomial is fitted by least squares to
the frames around an instant. The second and third derivative of unsmoothed positions are mostly noise.
"""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from observer.features.space import BodySize
from observer.tracks import Floats

DEGREE = 3
"""The lowest degree that has a third derivative."""
WINDOW_S = 0.23
"""Seven frames at 30 Hz: shorter than a stroke of a hand, longer than the jitter of a tracker."""
FEWEST_FRAMES = 5
LONGEST_S = 20.0
"""Of a longer movement only the newest part is kept, so that neither memory nor time grows."""


def window_frames(rate_hz: float) -> int:
    """The odd number of frames in WINDOW_S at this rate, at least FEWEST_FRAMES."""
    return max(2 * round((WINDOW_S * rate_hz - 1) / 2) + 1, FEWEST_FRAMES)


@lru_cache(maxsize=16)
def coefficients(frames: int, rate_hz: float) -> Floats:
    """(4, frames): rows give position, velocity, acceleration and jerk in the middle of the window, per s, s² and s³.

    k! times row k of the pseudo-inverse of (t^0 t^1 t^2 t^3), t in seconds from the middle.
    """
    t = (np.arange(frames) - (frames - 1) / 2) / rate_hz
    solved, *_ = np.linalg.lstsq(np.vander(t, DEGREE + 1, increasing=True), np.eye(frames), rcond=None)
    rows: Floats = solved * np.array([[float(math.factorial(k))] for k in range(DEGREE + 1)])
    return rows


def derivatives(tracks: Floats, rate_hz: float, frames: int | None = None) -> Floats:
    """(T, P, D) tracks -> (4, T - frames + 1, P, D): position, velocity, acceleration, jerk in each middle.

    NaN where a part is not seen (NaN) in any frame of the window.
    """
    width = frames or window_frames(rate_hz)
    if len(tracks) < width:
        return np.empty((DEGREE + 1, 0, *tracks.shape[1:]))
    windows = np.lib.stride_tricks.sliding_window_view(tracks, width, axis=0)
    smoothed: Floats = np.moveaxis(windows @ coefficients(width, rate_hz).T, -1, 0)
    return smoothed


class Course:
    """Places (T, P, 2), right and up, and their derivatives (T', 3, P, 2): velocity, acceleration, jerk.

    body_parts: names of the P parts. `size` is the performer's, in the image's unit, NaN until known.
    """

    def __init__(self, body_parts: Sequence[str], rate_hz: float) -> None:
        self.body_parts, self.rate_hz = tuple(body_parts), rate_hz
        self._width = window_frames(rate_hz)
        self._filter = coefficients(self._width, rate_hz)[1:]
        self._capacity = max(round(LONGEST_S * rate_hz), 4 * self._width)
        self._places = np.empty((self._capacity, len(body_parts), 2))
        self._moves = np.empty((self._capacity, 3, len(body_parts), 2))
        self._body = BodySize()
        self._count = 0
        self.size = float("nan")

    def __len__(self) -> int:
        """Number of frames."""
        return self._count

    def add(self, centres: Floats) -> None:
        """One frame: (P, 2) image coordinates, v down, NaN where not seen."""
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
