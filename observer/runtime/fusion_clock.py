"""The clock of the fusion service that speaks for the scene, as an observer measures it. Pure: the clock is passed in.

1. Each service has an estimate of its own: they may run on machines with different clocks.
2. What counts is the owner's, the service that publishes. A service that stands by says so in its status.
3. Of several that publish, as while a network is split, the first one counts until it stands by or is silent.
"""

from common import SECOND_NS
from common.clock_skew import QUERY_EVERY_S, ClockQuerier, ClockSkew
from common.message_types import STANDING_BY

SILENT_NS = round(3 * QUERY_EVERY_S * SECOND_NS)
"""An owner that has answered nothing for so long has gone: three questions."""
CLOCKS_LIMIT = 16
"""Estimates that are kept; a scene has two or three services."""


class FusionClock:
    """Measures the clocks of the scene's fusion services."""

    def __init__(self, querier: ClockQuerier) -> None:
        self._querier = querier
        self._skews: dict[str, ClockSkew] = {}
        self._owner, self._owner_answered_ns = "", 0

    def skew_s(self) -> float | None:
        """Seconds by which our clock is ahead of the owner's; None before its first answer. To be called in a loop."""
        self._querier.ask_if_due()
        for status, reading in self._querier.readings():
            # The one that answered last is the last in the dictionary.
            self._skews[status.id] = skew = self._skews.pop(status.id, None) or ClockSkew()
            skew.note(reading)
            if status.reason.startswith(STANDING_BY):
                self._owner = "" if self._owner == status.id else self._owner
            elif status.id == self._owner or self._is_silent(reading.answered_ns):
                self._owner, self._owner_answered_ns = status.id, reading.answered_ns
        while len(self._skews) > CLOCKS_LIMIT:
            del self._skews[next(name for name in self._skews if name != self._owner)]
        ahead_s = self._skews[self._owner].skew_s if self._owner else None
        return None if ahead_s is None else -ahead_s

    def _is_silent(self, now_ns: int) -> bool:
        return not self._owner or abs(now_ns - self._owner_answered_ns) > SILENT_NS
