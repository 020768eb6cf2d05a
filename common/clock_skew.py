"""The skew of another machine's clock, measured by querying its status. Pure: clock and link are passed in.

1. We query at t0 and receive at t1 by our clock; their clock showed r in between. The skew lies between r - t1 and
   r - t0 (Cristian, Probabilistic clock synchronization, 1989), so the fastest answer is the most precise.
2. Of the last readings the most precise one counts, unless the newest contradicts it: a clock that was set, or has
   stopped, is believed as it is now.
"""

from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from common import SECOND_NS
from common.messages import StatusMessage
from common.wire import BadMessage, decode_from

if TYPE_CHECKING:
    from common.subsession import SubSession

READINGS_LIMIT = 8
DRIFT = 200e-6
"""Seconds per second by which two machines' clocks may drift between readings; quartz stays well below."""
QUERY_EVERY_S = 1.0
ANSWER_TIMEOUT_S = 1.0
"""A slower answer is useless for a clock."""
ANSWERS_LIMIT = 4096


@dataclass(frozen=True, slots=True)
class ClockReading:
    """One answer: asked_ns and answered_ns by our clock, shown_ns by theirs; Unix epoch."""

    asked_ns: int
    shown_ns: int
    answered_ns: int

    @property
    def skew_ns(self) -> int:
        """The middle of the possible range."""
        return self.shown_ns - (self.asked_ns + self.answered_ns) // 2

    @property
    def doubt_ns(self) -> int:
        """The largest possible distance of the true skew from the middle."""
        return abs(self.answered_ns - self.asked_ns) // 2


class ClockSkew:
    """The skew of one other clock."""

    def __init__(self) -> None:
        self._readings: deque[ClockReading] = deque(maxlen=READINGS_LIMIT)
        self.best: ClockReading | None = None
        """The reading that counts; None before the first."""

    def note(self, reading: ClockReading) -> None:
        """Add a reading; the earlier ones are dropped if it contradicts them (rule 2)."""
        if any(not _agree(reading, old) for old in self._readings):
            self._readings.clear()
        self._readings.append(reading)
        # Stored, because it is read with every message and changes once a second.
        self.best = min(self._readings, key=lambda candidate: candidate.doubt_ns)

    @property
    def least_ns(self) -> int | None:
        """The skew if the answer with the shortest way back took no time; None before the first reading."""
        return max((each.shown_ns - each.answered_ns for each in self._readings), default=None)

    @property
    def skew_s(self) -> float | None:
        """Seconds by which the other clock is ahead of ours, negative if behind; None before the first reading."""
        return None if self.best is None else self.best.skew_ns / SECOND_NS


class ClockQuerier:
    """Queries all statuses under `key`; wake: called in the mesh's thread when an answer has arrived."""

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
        self._answers: deque[tuple[str, bytes, int, int]] = deque(maxlen=ANSWERS_LIMIT)
        """Key and payload of each, when it was asked for, and when it arrived."""
        self._asked_ns: int | None = None

    def ask_if_due(self) -> bool:
        """Send a query if one is due; returns immediately whether it was sent. To be called in a loop."""
        now_ns = self._clock()
        if self._asked_ns is not None and abs(now_ns - self._asked_ns) < self._every_ns:
            return False
        self._asked_ns = now_ns

        def answered(key: str, payload: bytes) -> None:
            self._answers.append((key, payload, now_ns, self._clock()))
            self._wake()

        self._link.request(self._key, answered, ANSWER_TIMEOUT_S)
        return True

    def readings(self) -> list[tuple[StatusMessage, ClockReading]]:
        """The readings since the last call, each with the status that was the answer; its id is the one in the key."""
        readings = []
        while self._answers:
            key, payload, asked_ns, answered_ns = self._answers.popleft()
            with suppress(BadMessage):
                status = decode_from(key, StatusMessage, payload)
                if status.at_ns is not None:
                    readings.append((status, ClockReading(asked_ns, status.at_ns, answered_ns)))
        return readings


def _agree(new: ClockReading, old: ClockReading) -> bool:
    drift_ns = abs(new.answered_ns - old.answered_ns) * DRIFT
    return abs(new.skew_ns - old.skew_ns) <= new.doubt_ns + old.doubt_ns + drift_ns
