"""Notices that something begins to move in pictures of nobody who moves; far cheaper than a tracker. Pure.

A picture of ROWS x COLUMNS cells of grey has changed if CELLS of them or more differ from their mean over the last
AVERAGE_S by more than LEAST_GREY and by more than NOISES times what they differ by while nobody moves, which is learned
cell by cell. Before the comparison the mean is brought to the picture's brightness.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from common import SECOND_NS

Cells = NDArray[np.float32]

ROWS, COLUMNS = 60, 80
AVERAGE_S, LEARN_S = 0.7, 3.0
CELLS, LEAST_GREY, NOISES = 2, 4.0, 6.0
LEARN_EVERY_S, WAITS_S = 0.1, 0.5
"""A difference is learned as noise only if so much later nobody has moved: the begin of a movement is none."""
MOST_CHANGED = 0.6
"""If more of the cells have changed the light has, or the camera: the mean starts over."""


class MotionGate:
    """Compares each picture with those before it in which nobody moved either."""

    def __init__(self) -> None:
        self._mean: Cells | None = None
        self._variance: Cells = np.zeros((ROWS, COLUMNS), np.float32)
        self._limit: Cells = np.full((ROWS, COLUMNS), LEAST_GREY, np.float32)
        self._waiting: deque[tuple[int, Cells, float]] = deque()
        self._before_ns, self._unlearned_s = 0, 0.0

    def forget(self) -> None:
        """Somebody moves: the next picture is the first to compare with. What was learned of noise stays."""
        self._mean = None
        self._waiting.clear()

    def update(self, cells: Cells, at_ns: int) -> bool:
        """Whether this picture, captured at `at_ns`, has changed."""
        seconds = min(max((at_ns - self._before_ns) / SECOND_NS, 0.0), 1.0)
        self._before_ns = at_ns
        if self._mean is None:
            self._mean = cells.copy()
            return False
        mean = self._mean * _brighter(cells, self._mean)
        change = cells - mean
        difference = np.abs(change)
        count = int(np.count_nonzero(difference > self._limit))
        if count > MOST_CHANGED * difference.size:
            self._mean = cells.copy()
            self._waiting.clear()
            return True
        step = np.float32(min(seconds / AVERAGE_S, 1.0))
        self._mean = np.asarray(mean + change * step, np.float32)
        self._unlearned_s += seconds
        if self._unlearned_s >= LEARN_EVERY_S:
            self._learn(difference, at_ns, self._unlearned_s)
            self._unlearned_s = 0.0
        return count >= CELLS

    def _learn(self, difference: Cells, at_ns: int, seconds: float) -> None:
        self._waiting.append((at_ns, difference, seconds))
        changed = False
        while self._waiting and not 0 <= at_ns - self._waiting[0][0] < WAITS_S * SECOND_NS:
            _, noise, lasted_s = self._waiting.popleft()
            self._variance += (noise * noise - self._variance) * np.float32(min(lasted_s / LEARN_S, 1.0))
            changed = True
        if changed:
            self._limit = np.maximum(np.float32(LEAST_GREY), np.float32(NOISES) * np.sqrt(self._variance))


def _brighter(cells: Cells, mean: Cells) -> np.float32:
    """By what factor the picture is brighter than the mean: the median over every fifth row and column."""
    ratios = np.sort(((cells[::5, ::5] + 1) / (mean[::5, ::5] + 1)).ravel())
    return np.float32(ratios[len(ratios) // 2])  # np.median takes longer than all the rest
