"""The course of one movement so far: where the parts were and how they moved, kept frame by frame. Pure."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from observer.effort.smoothing import coefficients, window_frames
from observer.space import BodySize
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
