"""How far another machine's clock is ahead of ours, from asking what time it has there. Pure: time is passed in.

1. Asked at t0 and answered at t1 by our clock, theirs showed r in between: the skew lies between r - t1 and r - t0
   (Cristian, Probabilistic clock synchronization, 1989), so the quickest answer says it best.
2. Of the last readings the one with the narrowest bounds counts, as long as the newest does not contradict it: a
   clock that was set, or stands still, is believed as it is now.
"""

from collections import deque
from dataclasses import dataclass

SECOND_NS = 1_000_000_000
READINGS_KEPT = 8
DRIFT = 200e-6
"""Seconds a second by which two machines' clocks may run apart between readings; quartz stays well below."""


@dataclass(frozen=True, slots=True)
class Reading:
    """One answer: asked_ns and answered_ns by our clock, shown_ns by theirs; Unix epoch."""

    asked_ns: int
    shown_ns: int
    answered_ns: int

    @property
    def skew_ns(self) -> int:
        """The middle of what is possible."""
        return self.shown_ns - (self.asked_ns + self.answered_ns) // 2

    @property
    def doubt_ns(self) -> int:
        """How far the true skew may be from the middle."""
        return abs(self.answered_ns - self.asked_ns) // 2


class ClockSkew:
    """The skew of one other clock."""

    def __init__(self) -> None:
        self._readings: deque[Reading] = deque(maxlen=READINGS_KEPT)
        self.best: Reading | None = None
        """The reading that counts; None before the first."""

    def note(self, reading: Reading) -> None:
        """One more answer; readings that it contradicts are forgotten (rule 2)."""
        if any(not _agree(reading, old) for old in self._readings):
            self._readings.clear()
        self._readings.append(reading)
        # Asked for with every message, and changed once a second.
        self.best = min(self._readings, key=lambda kept: kept.doubt_ns)

    @property
    def skew_s(self) -> float | None:
        """Seconds by which the other clock is ahead of ours, negative: behind; None before the first answer."""
        return None if self.best is None else self.best.skew_ns / SECOND_NS


def _agree(new: Reading, old: Reading) -> bool:
    drift_ns = abs(new.answered_ns - old.answered_ns) * DRIFT
    return abs(new.skew_ns - old.skew_ns) <= new.doubt_ns + old.doubt_ns + drift_ns
