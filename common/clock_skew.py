"""How far another machine's clock is ahead of ours, from asking what time it has there. Pure: time is passed in.

1. Asked at t0 and answered at t1 by our clock, theirs showed r in between: the skew lies between r - t1 and r - t0
   (Cristian, Probabilistic clock synchronization, 1989), so the quickest answer says it best.
2. Of the last readings the one with the narrowest bounds counts, as long as the newest does not contradict it: a
   clock that was set, or stands still, is believed as it is now.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from common import SECOND_NS
from common.messages import StatusMessage
from common.wire import BadMessage, decode

if TYPE_CHECKING:
    from common.subsession import SubSession

READINGS_KEPT = 8
DRIFT = 200e-6
"""Seconds a second by which two machines' clocks may run apart between readings; quartz stays well below."""


@dataclass(frozen=True, slots=True)
class ClockReading:
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
        self._readings: deque[ClockReading] = deque(maxlen=READINGS_KEPT)
        self.best: ClockReading | None = None
        """The reading that counts; None before the first."""

    def note(self, reading: ClockReading) -> None:
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


def _agree(new: ClockReading, old: ClockReading) -> bool:
    drift_ns = abs(new.answered_ns - old.answered_ns) * DRIFT
    return abs(new.skew_ns - old.skew_ns) <= new.doubt_ns + old.doubt_ns + drift_ns


QUERY_EVERY_S = 1.0
ANSWER_S = 1.0
"""An answer that takes longer says nothing of a clock."""


class ClockQuerier:
    """Asks all statuses under `key`; wake: called when an answer has come, from the mesh's thread."""

    def __init__(
        self,
        link: "SubSession",
        key: str,
        clock: Callable[[], int],
        wake: Callable[[], None] = lambda: None,
        every_s: float = QUERY_EVERY_S,
    ) -> None:
        self._link, self._key, self._clock, self._wake = link, key, clock, wake
        self._every_ns = round(every_s * SECOND_NS)
        self._answers: deque[tuple[bytes, int, int]] = deque(maxlen=4096)
        self._asked_ns: int | None = None

    def ask_if_due(self) -> bool:
        """To be called in a loop; returns at once, and whether it asked."""
        now_ns = self._clock()
        if self._asked_ns is not None and abs(now_ns - self._asked_ns) < self._every_ns:
            return False
        self._asked_ns = now_ns

        def answered(key: str, payload: bytes) -> None:
            self._answers.append((payload, now_ns, self._clock()))
            self._wake()

        self._link.request(self._key, answered, ANSWER_S)
        return True

    def readings(self) -> list[tuple[str, ClockReading]]:
        """What was answered since the last call: each process's id and its clock."""
        read = []
        while self._answers:
            payload, asked_ns, answered_ns = self._answers.popleft()
            try:
                status = decode(StatusMessage, payload)
            except BadMessage:
                continue
            if status.at_ns is not None:
                read.append((status.id, ClockReading(asked_ns, status.at_ns, answered_ns)))
        return read
