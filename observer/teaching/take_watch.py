"""Where a take begins and ends: from when the person begins to move until they stand still again. Pure.

People also hold still within a movement, with a hand up. So a take ends soon when they stand as they stood before it,
and later when they hold still in another posture, as after sitting down.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from common import SECOND_NS
from observer.runtime.pipeline import Resampler
from observer.stillness import Stillness
from observer.tracks import Floats, Tracks

MOVES_S = 0.15
"""A shorter twitch does not begin a movement."""
RESTS_S, HOLDS_S = 0.8, 2.0
"""Stillness of this length ends it: in the posture of before, and in another one."""
SAME_POSTURE = 0.4
"""A part that is nearer to its place of before than this share of the body's size is back."""
WAIT_S = 8.0
"""So long after the signal somebody has moved, or nobody performs."""
LONGEST_S = 12.0
"""No movement takes longer; a film in which nobody ever stands still is cut here."""
UNSEEN_S = 3.0
"""Without anybody in the pictures for so long from the signal on, the take is given up at once."""
Phase = Literal["waiting", "moving", "done"]


class TakeWatch:
    """Follows one take from its signal on; `fault` says why it is worth nothing, "" if it is worth keeping.

    begin_ns: time of the newest frame at the signal.
    """

    def __init__(self, begin_ns: int) -> None:
        self.begin_ns = self.end_ns = begin_ns
        self.phase: Phase = "waiting"
        self.fault = ""
        self._moves_since_ns: int | None = None
        self._rests_since_ns: int | None = None
        self._seen = False
        self._before: Floats | None = None

    @property
    def seconds(self) -> float:
        """Length so far."""
        return (self.end_ns - self.begin_ns) / SECOND_NS

    def update(self, at_ns: int, still: float, tracks: Tracks) -> None:
        """Take in one frame: how probably the person stands still in it, and where the parts are."""
        if self.phase == "done":
            return
        self.end_ns = max(at_ns, self.end_ns)
        visible, moves = bool(tracks.visible.any()), still < 0.5
        self._seen = self._seen or visible
        if visible and self.phase == "waiting" and (self._before is None or not moves):
            self._before = tracks.centres
        self._moves_since_ns = (self._moves_since_ns or at_ns) if moves else None
        self._rests_since_ns = None if moves else (self._rests_since_ns or at_ns)
        if self.phase == "waiting":
            self._wait(at_ns)
        else:
            needed_s = RESTS_S if self._is_back(tracks.centres) else HOLDS_S
            if self._lasts(self._rests_since_ns, at_ns, needed_s) or self.seconds >= LONGEST_S:
                self.phase = "done"

    def end(self) -> None:
        """The teacher ends the take: what was seen until now is it."""
        self.phase = "done"

    def fail(self, fault: str) -> None:
        """The take is worth nothing."""
        self.phase, self.fault = "done", fault

    def _wait(self, at_ns: int) -> None:
        if self._lasts(self._moves_since_ns, at_ns, MOVES_S):
            self.phase = "moving"
        elif not self._seen and self.seconds >= UNSEEN_S:
            self.phase, self.fault = "done", "nobody was seen: stand where the camera sees head and hands"
        elif self.seconds >= WAIT_S:
            self.phase, self.fault = "done", f"nobody moved within {WAIT_S:g} s of the signal"

    def _is_back(self, centres: Floats) -> bool:
        """Whether no part is far from its place before the movement, wherever the person has gone since."""
        if self._before is None:
            return True
        known = np.isfinite(centres).all(axis=1) & np.isfinite(self._before).all(axis=1)
        if not known.any():
            return True
        before = self._before[known]
        way = centres[known] - before
        way -= np.median(way, axis=0)
        size = float(np.ptp(before, axis=0).max())
        return bool(np.hypot(way[:, 0], way[:, 1]).max() <= SAME_POSTURE * size)

    @staticmethod
    def _lasts(since_ns: int | None, at_ns: int, seconds: float) -> bool:
        return since_ns is not None and at_ns - since_ns >= seconds * SECOND_NS


class StillnessStream:
    """P(the person is still) in frames of any rate, by the measure of the models (observer/stillness.py)."""

    def __init__(self, body_parts: Sequence[str], rate_hz: float) -> None:
        self._stillness, self._resampler = Stillness(body_parts, rate_hz), Resampler(rate_hz)
        self.probability = 0.5

    def update(self, at_ns: int, tracks: Tracks) -> None:
        """Take in one frame."""
        for instant in self._resampler.update(at_ns, tracks):
            self.probability = self._stillness.update(instant)
