"""Tells whether a process keeps up with what arrives: an observer with its frames, fusion with posteriors. Pure.

A process that does not keep up uses the newest and leaves out the others. What it would have left out anyway, as its
tracker rests (observer/runtime/pacing.py), does not count: that is no fault.
"""

from collections import deque

from common import SECOND_NS
from common.message_types import OVERLOADED

SECONDS_IN_A_ROW = 4
"""A process is behind, or keeps up again, when so many seconds in a row show it: a single stall is no fault."""
BEHIND_SHARE, ENOUGH_SHARE = 0.7, 0.9
"""It is behind while it uses less than the first share of what arrives, until it uses more than the second."""
RENEWED = 1.5
"""The complaint is renewed when the rate has changed by this factor, so that it does not change each second."""


class LoadMeter:
    """Counts what a process uses of what arrives, and what it is too slow for.

    items: the word for what arrives, e.g. pictures. way_out: what to do. complaint: what an overloaded process says of
    itself; "" if it keeps up.
    """

    def __init__(self, items: str, way_out: str) -> None:
        self._items, self._way_out = items, way_out
        self._seconds: deque[tuple[float, float]] = deque(maxlen=SECONDS_IN_A_ROW)
        self._begun_ns: int | None = None
        self._used = self._missed = 0
        self._stated_hz = 0.0
        self.complaint = ""

    def record(self, at_ns: int, missed: int, used: int = 1) -> None:
        """Note how many were used at `at_ns`; `missed`: those before them that would have been used, too."""
        if self._begun_ns is None or at_ns < self._begun_ns:
            self._begun_ns = at_ns
            return
        self._used, self._missed = self._used + used, self._missed + missed
        elapsed_s = (at_ns - self._begun_ns) / SECOND_NS
        if elapsed_s >= 1:
            self._seconds.append((self._used / elapsed_s, (self._used + self._missed) / elapsed_s))
            self._begun_ns, self._used, self._missed = at_ns, 0, 0
            self._judge()

    def _judge(self) -> None:
        shares = [used_hz / offered_hz if offered_hz else 1.0 for used_hz, offered_hz in self._seconds]
        used_hz, offered_hz = (sum(rates) / len(shares) for rates in zip(*self._seconds, strict=True))
        if len(shares) < SECONDS_IN_A_ROW:
            return
        if self.complaint and min(shares) >= ENOUGH_SHARE:
            self.complaint = ""
        elif (not self.complaint and max(shares) < BEHIND_SHARE) or (self.complaint and self._is_outdated()):
            self._stated_hz = used_hz
            numbers = f"uses {_rounded(used_hz)} of {_rounded(offered_hz)} {self._items} a second"
            self.complaint = f"{numbers}: {OVERLOADED}; {self._way_out}"

    def _is_outdated(self) -> bool:
        factors = [used_hz / self._stated_hz for used_hz, _ in self._seconds]
        return min(factors) > RENEWED or max(factors) < 1 / RENEWED


def _rounded(hz: float) -> str:
    return f"{hz:.0f}" if hz >= 10 else f"{hz:.2g}"
