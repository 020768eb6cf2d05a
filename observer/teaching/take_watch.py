"""Where a take begins and ends: from when the person begins to move until they stand still again. Pure.

People also hold still within a movement, with a hand up. So a take ends soon when they stand as they stood before it,
and later when they hold still in another posture, as after sitting down.

Claps, by which a person away from the keyboard begins a take: both hands come together quickly, before the body and
below the chin, and part again. Their lengths are in sizes of the body as `observer.body.BodyFrame` measures it: hanging
hands are about two below the head.
"""

from collections import deque
from collections.abc import Sequence
from typing import Literal

import numpy as np

from common import SECOND_NS
from observer.body import BodyFrame, Stillness
from observer.prepared_tracks import Resampler
from observer.tracks import Floats, Tracks

MOVES_S = 0.15
"""A shorter twitch does not begin a movement."""
RESTS_S, HOLDS_S = 0.8, 2.0
"""Stillness of this length ends it: in the posture of before, and in another one."""
SAME_POSTURE = 0.4
"""A part that is nearer to its place of before than this share of the body's size is back."""
LEAST_WAY = 0.06
"""A part must go so far, beside what the whole body sways, or the person has only shifted their weight."""
WAIT_S = 8.0
"""If nobody has moved by this time after the signal, the take fails."""
LONGEST_TAKE_S = 12.0
"""No movement takes longer; a film in which nobody ever stands still is cut here."""
UNSEEN_S = 3.0
"""If nobody has been seen by this time after the signal, the take fails."""
Phase = Literal["waiting", "moving", "done"]


class TakeWatch:
    """Follows one take from its signal on; `fault` says why it cannot be used, "" if it can.

    begin_ns: time of the newest frame at the signal.
    """

    def __init__(self, begin_ns: int) -> None:
        self.begin_ns = self.end_ns = self._signal_ns = begin_ns
        self.phase: Phase = "waiting"
        self.fault = ""
        self._moves_since_ns: int | None = None
        self._rests_since_ns: int | None = None
        self._seen = False
        self._way = 0.0
        self._before: Floats | None = None

    @property
    def seconds(self) -> float:
        """Length so far."""
        return (self.end_ns - self.begin_ns) / SECOND_NS

    def update(self, at_ns: int, still: float, tracks: Tracks, complaint: str = "") -> None:
        """Take in one frame: how probably the person stands still in it, and where the parts are; complaint: why the
        tracker finds nobody."""
        if self.phase == "done":
            return
        self.end_ns = max(at_ns, self.end_ns)
        visible, moves = bool(tracks.visible.any()), still < 0.5
        self._seen = self._seen or visible
        if visible and self.phase == "waiting" and (self._before is None or not moves):
            self._before = tracks.centres
        self._moves_since_ns = (self._moves_since_ns or at_ns) if moves else None
        self._rests_since_ns = None if moves else (self._rests_since_ns or at_ns)
        away = self._away(tracks.centres)
        if self.phase == "waiting":
            self._wait(at_ns, complaint)
        else:
            self._way = max(self._way, away or 0.0)
            needed_s = RESTS_S if away is None or away <= SAME_POSTURE else HOLDS_S
            if self._lasts(self._rests_since_ns, at_ns, needed_s) or self.seconds >= LONGEST_TAKE_S:
                self._stop(at_ns, away)

    def end(self, fault: str = "") -> None:
        """End the take with the newest frame; fault: why it cannot be used."""
        self.phase, self.fault = "done", fault

    def _wait(self, at_ns: int, complaint: str = "") -> None:
        waited_s = (at_ns - self._signal_ns) / SECOND_NS
        if self._lasts(self._moves_since_ns, at_ns, MOVES_S):
            self.phase = "moving"
        elif not self._seen and waited_s >= UNSEEN_S:
            self.end(complaint or "nobody was seen: stand where the camera sees head and hands")
        elif waited_s >= WAIT_S:
            self.end(f"nobody moved within {WAIT_S:g} s of the signal")

    def _stop(self, at_ns: int, away: float | None) -> None:
        """The person rests: the movement has ended, or there was none yet and the take waits on."""
        if away is None or self._way >= LEAST_WAY:
            self.phase = "done"
            return
        self.phase, self._way, self.begin_ns = "waiting", 0.0, at_ns
        self._wait(at_ns)

    def _away(self, centres: Floats) -> float | None:
        """The distance of a part from its place before the movement, seen from the body, in sizes of the body.

        None where it is not known."""
        if self._before is None:
            return None
        known = np.isfinite(centres).all(axis=1) & np.isfinite(self._before).all(axis=1)
        before = self._before[known]
        size = float(np.ptp(before, axis=0).max()) if known.any() else 0.0
        if not size > 0:
            return None
        way = centres[known] - before
        way -= np.median(way, axis=0)
        return float(np.hypot(way[:, 0], way[:, 1]).max()) / size

    @staticmethod
    def _lasts(since_ns: int | None, at_ns: int, seconds: float) -> bool:
        return since_ns is not None and at_ns - since_ns >= seconds * SECOND_NS


class StillnessStream:
    """P(the person is still) in frames of any rate, by the measure of the models (observer/body.py)."""

    def __init__(self, body_parts: Sequence[str], rate_hz: float) -> None:
        self._stillness, self._resampler = Stillness(body_parts, rate_hz), Resampler(rate_hz)
        self.probability = 0.5

    def update(self, at_ns: int, tracks: Tracks) -> None:
        """Take in one frame."""
        for instant in self._resampler.update(at_ns, tracks):
            self.probability = self._stillness.update(instant)


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
