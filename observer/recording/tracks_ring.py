"""The newest tracks of one observer, in memory only; a few dozen bytes a frame. Pure."""

import numpy as np
from numpy.typing import NDArray

from common import SECOND_NS
from observer.tracks import Floats

FIRST_FRAMES = 256
RING_GROWTH = 1.5


class TracksRing:
    """Frames with their times, oldest first; those older than `memory_s` before the newest are forgotten.

    Each frame has two times in ns: that of the motion, in which spans are cut, and that of its capture, by which others
    name a moment. Not thread-safe.
    """

    def __init__(self, parts: int, memory_s: float) -> None:
        self.memory_s = memory_s
        self._parts = parts
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._begin = self._end = 0
        self._at_ns: NDArray[np.int64] = np.empty(0, np.int64)
        self._captured_ns: NDArray[np.int64] = np.empty(0, np.int64)
        self._centres: NDArray[np.float32] = np.empty((0, self._parts, 2), np.float32)

    def __len__(self) -> int:
        return self._end - self._begin

    @property
    def at_ns(self) -> NDArray[np.int64]:
        """(F,) times of the motion, increasing."""
        return self._at_ns[self._begin : self._end]

    @property
    def captured_ns(self) -> NDArray[np.int64]:
        """(F,) times of capture."""
        return self._captured_ns[self._begin : self._end]

    @property
    def centres(self) -> NDArray[np.float32]:
        """(F, P, 2) tracks."""
        return self._centres[self._begin : self._end]

    def append(self, at_ns: int, captured_ns: int, centres: Floats) -> None:
        """Take in one frame, later than the newest one; (P, 2) tracks."""
        if self._end == len(self._at_ns):
            self._make_room()
        self._at_ns[self._end], self._captured_ns[self._end] = at_ns, captured_ns
        self._centres[self._end] = centres
        self._end += 1
        oldest_ns = at_ns - self.memory_s * SECOND_NS
        while self._at_ns[self._begin] < oldest_ns:
            self._begin += 1

    def _make_room(self) -> None:
        """Move the frames to the front of new arrays, which grow only if less than a third is free there."""
        frames = len(self)
        capacity = max(FIRST_FRAMES, round(RING_GROWTH * frames))
        at_ns, captured_ns = np.empty(capacity, np.int64), np.empty(capacity, np.int64)
        centres = np.empty((capacity, self._parts, 2), np.float32)
        at_ns[:frames], captured_ns[:frames], centres[:frames] = self.at_ns, self.captured_ns, self.centres
        self._at_ns, self._captured_ns, self._centres = at_ns, captured_ns, centres
        self._begin, self._end = 0, frames
