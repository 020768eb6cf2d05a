"""A phone's times as ours: the skew of its clock, measured as between machines (common/clock_skew.py). Pure.

1. We send a numbered question and the phone answers with its clock; the answer with the shortest way counts.
2. A page that looks at pictures lets a question wait and answers at once: the way there is longer than the way back.
   How long the line alone takes there and back a ping tells, which the browser answers itself.
3. A picture cannot have been taken after its tracks arrived.
4. Tracks that are too late, or no newer than the last ones, are dropped: the newest come first.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from common import MS_NS, SECOND_NS
from common.clock_skew import READINGS_LIMIT, ClockReading, ClockSkew

LATE_S = 1.0
"""Older tracks are dropped: half the time after which fusion drops a posterior (fusion.drop_s)."""
QUESTIONS_LIMIT = 16
"""Questions that may wait for an answer; one is sent each second."""


@dataclass(slots=True)
class PhoneClock:
    """now_ns: our clock (Unix epoch, ns). dropped: how many tracks were too late, or no newer than the last."""

    now_ns: Callable[[], int]
    dropped: int = 0
    _skew: ClockSkew = field(default_factory=ClockSkew)
    _asked_ns: dict[int, int] = field(default_factory=dict)
    _lines_ns: deque[int] = field(default_factory=lambda: deque(maxlen=READINGS_LIMIT))
    _number: int = 0
    _newest_ns: int = 0

    def ask(self) -> int:
        """The number of a question that is sent now."""
        self._number += 1
        self._asked_ns[self._number] = self.now_ns()
        if len(self._asked_ns) > QUESTIONS_LIMIT:
            del self._asked_ns[min(self._asked_ns)]
        return self._number

    def answer(self, number: int, phone_ms: float) -> None:
        """The phone's answer to a question; one that was never asked, or was answered, counts nothing."""
        asked_ns = self._asked_ns.pop(number, None)
        now_ns = self.now_ns()
        if asked_ns is not None and now_ns >= asked_ns:
            self._skew.note(ClockReading(asked_ns, round(phone_ms * MS_NS), now_ns))

    def note_line(self, seconds: float) -> None:
        """How long a ping took there and back."""
        self._lines_ns.append(round(seconds * SECOND_NS))

    @property
    def _skew_ns(self) -> int | None:
        """By how much the phone's clock is ahead; None before the first answer."""
        best, least_ns = self._skew.best, self._skew.least_ns
        if best is None or least_ns is None or not self._lines_ns:
            return None if best is None else best.skew_ns
        return min(best.skew_ns, least_ns + min(self._lines_ns) // 2)

    def captured_ns(self, phone_ms: float) -> int | None:
        """When a picture was taken, by our clock (Unix epoch, ns), as its tracks arrive now; None: drop them."""
        skew_ns, now_ns = self._skew_ns, self.now_ns()
        if skew_ns is None:
            self.dropped += 1
            return None
        if self._newest_ns > now_ns:
            self._newest_ns = 0  # our clock was set back
        at_ns = min(round(phone_ms * MS_NS) - skew_ns, now_ns)
        if now_ns - at_ns > LATE_S * SECOND_NS or at_ns <= self._newest_ns:
            self.dropped += 1
            return None
        self._newest_ns = at_ns
        return at_ns
