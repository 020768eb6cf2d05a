"""Bad messages are logged once a minute per observer, however many come. Pure: time is passed in."""

from collections import Counter

MINUTE_NS = 60_000_000_000
OBSERVERS_LIMIT = 256
"""So many senders are told apart; a peer that invents names for itself cannot fill the memory."""


class Complaints:
    """Counts what could not be used, and says when to log it."""

    def __init__(self, every_ns: int = MINUTE_NS) -> None:
        self._every_ns = every_ns
        self._counts: dict[str, Counter[str]] = {}
        self.totals: dict[str, Counter[str]] = {}
        """Per sender, how many messages were not used since the start, by reason."""
        self._said_ns: dict[str, int] = {}

    def note(self, observer: str, reason: str, detail: str, now_ns: int) -> str | None:
        """One more bad message; returns the line to log, or None while the last one is younger than a minute."""
        if observer not in self._counts and len(self._counts) >= OBSERVERS_LIMIT:
            observer = "others"
        counts = self._counts.setdefault(observer, Counter())
        counts[reason] += 1
        self.totals.setdefault(observer, Counter())[reason] += 1
        if now_ns - self._said_ns.get(observer, -self._every_ns) < self._every_ns:
            return None
        self._said_ns[observer] = now_ns
        told = ", ".join(f"{name} {count}" for name, count in counts.most_common())
        counts.clear()
        return f"{observer}: messages not used since last told: {told}; newest: {detail}"
