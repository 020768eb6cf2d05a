"""The start of a scene: no verdict before every observer has begun, or a grace period is over. Pure: time is passed in.

The design: fusion.md, "The start".

1. The wait begins with the first posterior of any observer. It ends for good when each observer of the roster has sent
   something, and at the latest after the grace. An observer that dies later delays nothing.
2. Movements are detected meanwhile. Their verdicts are withheld until the wait ends, so that what the observers that
   had begun decided is not lost.
3. An abstention on a movement that began during the wait is dropped, also after it: the observers that might have
   decided had not begun, or have not seen its beginning.
4. A service that continues from another one's messages does not wait: the scene has begun long before.
"""

from collections.abc import Sequence

from common import SECOND_NS
from common.messages import VerdictMessage
from common.vocabulary import ABSTAIN
from fusion.engine.roster import AgedPosterior

NAMES_LIMIT = 3
"""Awaited observers that `why` lists by name."""


class RosterStart:
    """Withholds the verdicts of a scene until its roster has begun. Without a grace period it never does."""

    def __init__(self) -> None:
        self._grace_ns = 0
        self._since_ns: int | None = None
        self._until_ns: int | None = None
        self._withheld: list[VerdictMessage] = []
        self._missing: list[str] = []
        self.waits = False
        """Whether verdicts are withheld now."""

    def begin(self, grace_s: float) -> None:
        """Wait at most `grace_s` seconds after the first posterior."""
        self._grace_ns, self._since_ns = round(grace_s * SECOND_NS), None
        self._until_ns = None
        self.waits = grace_s > 0

    def end(self, verdicts: Sequence[VerdictMessage] = ()) -> list[VerdictMessage]:
        """End the wait, because the scene has begun long ago; returns what is to be published, as `release` does."""
        self.waits = False
        return self.release(verdicts)

    def update(self, posteriors: Sequence[AgedPosterior], now_ns: int) -> None:
        """Take one step; posteriors: one for each observer of the roster."""
        if not self.waits:
            return
        self._missing = [
            posterior.observer for posterior in posteriors if posterior.age_s is None and posterior.state == "silent"
        ]
        if len(self._missing) == len(posteriors):
            return
        if self._since_ns is None or now_ns < self._since_ns:
            self._since_ns = now_ns
        self.waits = bool(self._missing) and now_ns - self._since_ns < self._grace_ns
        self._until_ns = now_ns

    def release(self, verdicts: Sequence[VerdictMessage]) -> list[VerdictMessage]:
        """The verdicts to publish now, of those made in this step and those withheld before."""
        if not verdicts and not self._withheld:
            return []
        self._withheld += [verdict for verdict in verdicts if not self._is_early_abstention(verdict)]
        if self.waits:
            return []
        released, self._withheld = self._withheld, []
        return released

    def _is_early_abstention(self, verdict: VerdictMessage) -> bool:
        """Whether it is an abstention on a movement that began during the wait (rule 3)."""
        if verdict.label != ABSTAIN or verdict.revises is not None:
            return False
        return self.waits or (self._until_ns is not None and verdict.began_ns <= self._until_ns)

    @property
    def why(self) -> str:
        """Which observers have not begun, in a line."""
        names, more = self._missing[:NAMES_LIMIT], len(self._missing) - NAMES_LIMIT
        return f"waiting for {', '.join(names)}{f' and {more} more' if more > 0 else ''} to begin"
