"""How far each observer's labels can be trusted: who is named as contradicted. Pure: time is passed in.

It changes no weight. label_reliability is the product of

1. the reliability that verdicts have taught (reliability.py, rule 1);
2. the mean relative steadiness over STEADY_S (reliability.py, rule 6): that of an honest observer falls for some tenths
   of a second where its posterior changes at once, and one that jumps about stays low;
3. P(it does not contradict decided movements). From the decision of a movement on, the steps count in which two or more
   others vote, all of them for the decided label. An observer that votes for another label in most of them has left it.
   Each such movement has the Bayes factor LEFT_BY_LIAR / LEFT_BY_HONEST, each other one (1 - LEFT_BY_LIAR) /
   (1 - LEFT_BY_HONEST), their sum in nats is never negative, and ODDS are those at the start: three movements more that
   were left than is usual expose an observer that agrees until its vote has no effect.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from common import SECOND_NS
from common.messages import OngoingMovement, Vote
from fusion.engine.roster import POOLED_STATES, ObserverRecord

STEADY_S = 8.0
LEFT_BY_HONEST, LEFT_BY_LIAR = 0.05, 0.8
"""P(a movement is left). Observers of recorded people left 1.1 % of them at 4 Hz, .7 % at 30 Hz, and at most two in one
film of a dozen."""
ODDS, MOST_EVIDENCE = 0.001, 12.0
LEFT, STAYED = math.log(LEFT_BY_LIAR / LEFT_BY_HONEST), math.log((1 - LEFT_BY_LIAR) / (1 - LEFT_BY_HONEST))
LEAST_S = 0.3
"""A movement in which the others agree for less shows nothing."""
MOST_SHARE = 0.5
REFRESH_S = 0.1
"""Steps that follow each other sooner show nothing new."""
SHOWN = 0.9
"""A label reliability of this or more is not published."""


@dataclass(slots=True)
class _Record:
    """One observer. steady: (2). evidence: (3), nats. compared_s, contradicted_s: of the movement in progress."""

    steady: float = 1.0
    evidence: float = 0.0
    compared_s: float = 0.0
    contradicted_s: float = 0.0

    def close(self) -> None:
        """The movement has ended."""
        if self.compared_s >= LEAST_S:
            has_left = self.contradicted_s >= MOST_SHARE * self.compared_s
            self.evidence = min(max(self.evidence + (LEFT if has_left else STAYED), 0.0), MOST_EVIDENCE)
        self.compared_s = self.contradicted_s = 0.0

    @property
    def believed(self) -> float:
        """P(it does not contradict decided movements), over that at the start."""
        return (1.0 + ODDS) / (1.0 + ODDS * math.exp(self.evidence))


@dataclass(slots=True)
class LabelTrust:
    """The reliability of each observer's labels; `update` takes each step."""

    reliability: Mapping[str, float] = field(default_factory=dict)
    """By observer, where it is below SHOWN."""
    _records: dict[str, _Record] = field(default_factory=dict)
    _movement: str | None = None
    _now_ns: int = 0

    def update(
        self,
        votes: Mapping[str, Vote],
        movement: OngoingMovement | None,
        records: Mapping[str, ObserverRecord],
        now_ns: int,
    ) -> None:
        """Take the votes of this step. records: what is known of each observer, (1) too."""
        elapsed_ns = now_ns - self._now_ns
        if 0 <= elapsed_ns < REFRESH_S * SECOND_NS:
            return
        seconds = min(max(elapsed_ns / SECOND_NS, 0.0), 1.0)
        self._now_ns = now_ns
        decided = movement.label if movement is not None else None
        name = movement.id if movement is not None and decided is not None else None
        if name != self._movement:
            self._movement = name
            for record in self._records.values():
                record.close()
        elif decided is not None:
            self._compare(votes, decided, seconds)
        share, result = 1.0 - math.exp(-seconds / STEADY_S), {}
        for observer, vote in votes.items():
            record = self._records.setdefault(observer, _Record())
            trust = records[observer].reliability if observer in records else 1.0
            if vote.state in POOLED_STATES and vote.reliability is not None:
                record.steady += (min(vote.reliability / trust, 1.0) - record.steady) * share
            reliability = trust * record.steady * record.believed
            if reliability < SHOWN:
                result[observer] = round(reliability, 3)
        self.reliability = result

    def _compare(self, votes: Mapping[str, Vote], decided: str, seconds: float) -> None:
        labels = {observer: vote.label for observer, vote in votes.items() if vote.label is not None}
        contradicting = [observer for observer, label in labels.items() if label != decided]
        if len(contradicting) > 1:
            return
        for observer in labels:
            if observer in self._records and (not contradicting or contradicting == [observer]) and len(labels) > 2:
                record = self._records[observer]
                record.compared_s += seconds
                record.contradicted_s += seconds if contradicting else 0.0
