"""Decodes posteriors that have arrived; unusable messages are counted by reason, logged once a minute and dropped."""

import logging
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

from common import MINUTE_NS
from common.inbox import Arrival
from common.keys import IDENTIFIER, observer_of
from common.messages import ObserverPosterior, ObserverStatistics, PosteriorMessage
from common.wire import BadMessage, decode_from
from fusion.engine.engine import FusionEngine

log = logging.getLogger("labanmesh.fusion")
SENDERS_LIMIT = 256
"""Further senders are counted together as "others", so that invented names fill no memory."""
NEWEST = 2
"""Messages of one observer that are read of a flood: if the last is a late copy, the one before may be the newest."""
FLOOD = 64
"""More arrivals than this in one step mean that the service has fallen behind, or is flooded."""


def newest(arrivals: Sequence[Arrival], most: int = NEWEST) -> list[Arrival]:
    """The last `most` arrivals of each key, in order of arrival; all of them when there are at most FLOOD.

    A posterior is cumulative, so only the newest of each observer count.
    """
    if len(arrivals) <= FLOOD:
        return list(arrivals)
    counts: Counter[str] = Counter()
    result = []
    for arrival in reversed(arrivals):
        if counts[arrival.key] < most:
            counts[arrival.key] += 1
            result.append(arrival)
    result.reverse()
    return result


class RejectionLog:
    """Counts rejected messages by sender and reason; gives a log line for each sender at most once a minute."""

    def __init__(self) -> None:
        self._since_logged: dict[str, Counter[str]] = {}
        self._logged_ns: dict[str, int] = {}
        self.totals: dict[str, Counter[str]] = {}
        """Rejected messages since the start, by sender and reason."""

    def add(self, sender: str, reason: str, detail: str, now_ns: int) -> str | None:
        """Count one message; returns the line to log, or None while the last one is younger than a minute."""
        if sender not in self.totals and (len(self.totals) >= SENDERS_LIMIT or not IDENTIFIER.match(sender)):
            sender = "others"
        recent = self._since_logged.setdefault(sender, Counter())
        recent[reason] += 1
        self.totals.setdefault(sender, Counter())[reason] += 1
        if now_ns - self._logged_ns.get(sender, -MINUTE_NS) < MINUTE_NS:
            return None
        self._logged_ns[sender] = now_ns
        counts = ", ".join(f"{name} {count}" for name, count in recent.most_common())
        recent.clear()
        return f"{sender}: messages rejected since the last line: {counts}; newest: {detail}"


class PosteriorIngest:
    """Reads the posteriors of one scene, and passes them to the engines of its people.

    first: the engine that also counts what cannot be read: of the first person, or of the only one.
    """

    def __init__(self, first: FusionEngine) -> None:
        self._first, self._rejections = first, RejectionLog()
        self._roster = frozenset(first.roster.rejected)

    def read(self, arrivals: Iterable[Arrival], now_ns: int) -> Iterator[ObserverPosterior]:
        """The posteriors in these messages; a bad one is counted and dropped, never raised."""
        for arrival in arrivals:
            observer = observer_of(arrival.key)
            if observer not in self._roster:
                # Not decoded, so that invented names cost little.
                self._log(observer, "unknown_observer", f"{len(arrival.payload)} bytes under {arrival.key}", now_ns)
                continue
            try:
                yield observer, decode_from(arrival.key, PosteriorMessage, arrival.payload)
            except BadMessage as error:
                self._first.roster.reject(observer, error.reason)
                self._log(observer, error.reason, error.detail, now_ns)

    def pass_on(self, posteriors: Iterable[ObserverPosterior], engine: FusionEngine, now_ns: int) -> list[int]:
        """Give the posteriors on one person to their engine; returns the capture times of those that it uses."""
        frames_ns = list[int]()
        for observer, message in posteriors:
            reason = engine.receive(observer, message, now_ns)
            if reason is None:
                frames_ns.append(message.captured_ns)
            else:
                self._log(observer, reason, f"seq {message.seq} of session {message.session}", now_ns)
        return frames_ns

    def statistics(self, roster: Sequence[str]) -> dict[str, ObserverStatistics]:
        """Clock skew and rejected messages of each observer of the scene, and of others that sent some."""
        rejected = self._rejections.totals
        return {
            observer: ObserverStatistics(
                skew_s=self._first.roster.skew_s(observer), rejected=rejected.get(observer, {})
            )
            for observer in dict.fromkeys((*roster, *rejected))
        }

    def _log(self, observer: str, reason: str, detail: str, now_ns: int) -> None:
        line = self._rejections.add(observer, reason, detail, now_ns)
        if line is not None:
            log.warning("%s", line)
