"""Claps of the hands in one observer's tracks, by which a person away from the keyboard begins a take. Pure.

Both hands come together quickly, before the body and below the chin, and part again. Lengths are in sizes of the body
as `observer.body.BodyFrame` measures it: hanging hands are about two below the head.
"""

from collections import deque
from collections.abc import Sequence

import numpy as np

from observer.body import BodyFrame
from observer.motion.even_rate import Resampler
from observer.tracks import Floats, Tracks

APART, TOGETHER, PARTED = 1.2, 0.5, 1.0
"""Distances of the hands before and after a clap, and in it: trackers see the middle of a palm, or the wrist."""
CLOSES_S, PARTS_S = 0.4, 0.8
"""Longest times from apart to together, and from together to apart again."""
EACH = 0.3
"""Share of the way together that each hand goes: a hand that is put to the other one does not clap."""
LEVEL = 0.25
"""The hands meet at the same height: this is how much they may differ."""
ASIDE, ABOVE, BELOW = 1.0, 0.3, 1.4
"""Where they meet: at most ASIDE beside the head, and from ABOVE to BELOW below it."""
CLAP_HZ = 15.0
LEFT, RIGHT, HEAD = "left_hand", "right_hand", "head"


class ClapWatch:
    """Counts claps in a stream of tracks of any rate; it needs both hands and the head, else it never counts any."""

    def __init__(self, body_parts: Sequence[str]) -> None:
        names = (LEFT, RIGHT, HEAD)
        self._rows = [list(body_parts).index(name) for name in names] if set(names) <= set(body_parts) else []
        self._frame = BodyFrame(names, CLAP_HZ)
        self._resampler = Resampler(CLAP_HZ)
        self._places: deque[Floats] = deque(maxlen=round((CLOSES_S + PARTS_S) * CLAP_HZ) + 1)
        self._met = -1
        """Index of the frame in `_places` in which the hands have met and not parted yet; -1: none."""
        self.count = 0

    def update(self, at_ns: int, tracks: Tracks) -> bool:
        """Take in one frame; whether a clap has just ended."""
        if not self._rows:
            return False
        clapped = False
        for instant in self._resampler.update(at_ns, Tracks(tracks.centres[self._rows])):
            clapped = self._step(instant) or clapped
        self.count += clapped
        return clapped

    def _step(self, tracks: Tracks) -> bool:
        _, size = self._frame.update(tracks)
        if not np.isfinite(tracks.centres).all() or not np.isfinite(size) or size <= 0:
            return False
        if len(self._places) == self._places.maxlen:
            self._met -= 1
        self._places.append(tracks.centres / size)
        distance = _apart(self._places[-1])
        if distance <= TOGETHER and self._met < 0 and self._closed_quickly():
            self._met = len(self._places) - 1
        if self._met < 0:
            return False
        if len(self._places) - 1 - self._met > PARTS_S * CLAP_HZ:
            self._met = -1
        elif distance >= PARTED:
            self._met = -1
            return True
        return False

    def _closed_quickly(self) -> bool:
        """Whether both hands came together just now, where people clap."""
        met = self._places[-1]
        recent = list(self._places)[-1 - round(CLOSES_S * CLAP_HZ) :]
        before = next((places for places in reversed(recent) if _apart(places) >= APART), None)
        if before is None:
            return False
        left, right, head = met
        middle = (left + right) / 2 - head
        if abs(left[1] - right[1]) > LEVEL or abs(middle[0]) > ASIDE or not ABOVE <= middle[1] <= BELOW:
            return False
        # The way of each hand towards where the other one was, relative to the head.
        way = before[1] - before[0]
        length = float(np.hypot(*way))
        towards = way / length
        body = head - before[2]
        ways = ((left - before[0] - body) @ towards, -(right - before[1] - body) @ towards)
        return bool(min(ways) >= EACH * length)


def _apart(places: Floats) -> float:
    """The distance of the hands."""
    return float(np.hypot(*(places[0] - places[1])))
