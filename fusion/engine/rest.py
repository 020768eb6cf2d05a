"""The pooled probability that the person rests; one observer may be wrong, stuck or hostile. Pure: time is passed in.

The design and its reasons: fusion.md, "Who may say that the person rests".
"""

import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import accumulate
from statistics import median

import numpy as np

from common import SECOND_NS
from common.message_types import CONTRADICTED
from common.probability import SMALLEST
from fusion.engine.roster import AgedPosterior
from fusion.engine.segments import NOTICED_S
from fusion.engine.trust import (
    BLUR,
    CONTRADICTS,
    HONEST,
    LEAST_TRUST,
    OBSERVATION_S,
    TRUSTED,
    among_contradicted,
    log_odds_of,
    nats_of,
    observed,
)

LEAST_SHARE = 0.1
"""An observer with a smaller weight than this share of the largest is left out."""
CLEAR_MARGIN = 0.25
"""Two that contradict each other have agreed again when the pooled rest is no further from 0 or 1."""
SIGHTED = 0.2
"""The least freshness of an observer that is compared: without a frame for a second it is not."""
STUCK_S = 4.0
"""Seconds; the movements of recorded people and the rest between them last 1 to 3.5 s."""
CHANGES_S, CHANGES_LIMIT = 12.0, 20.0
"""Changes of side are counted with this memory in seconds. Observers of recorded people reach 18.6, one that changes
with each of two frames a second 24."""
OFTENER = 1.5
"""Beside others that change sides often, as those of a person who moves in fits and starts, so many times as often."""
GAIN = 2.0
"""Observations that the information about one movement counts as; with 4, honest observers are named at .5 and 1 Hz."""
CHANGES_KEPT = 64
"""Changes of side that are remembered, for comparisons up to two seconds ago at 30 Hz."""
REFRESH_S = 0.25
"""While no observer changes sides, trust is computed anew at this interval."""


@dataclass(slots=True)
class _Voter:
    """One observer: its newest rest probability, and when it changed sides, newest last, by capture.

    information: of its posterior. before_ns: the frame before each change. changes: a decaying count. honest, course:
    P(honest) by comparison with others, and by its own course.
    """

    rest: float
    information: float
    captured_ns: int
    changed_ns: list[int] = field(default_factory=list)
    before_ns: list[int] = field(default_factory=list)
    changes: float = 0.0
    has_changed: bool = False
    honest: float = HONEST
    course: float = HONEST
    trust: float = 1.0

    def note(self, posterior: AgedPosterior, now_ns: int) -> None:
        """Take its newest posterior."""
        last_ns, least = self.captured_ns, min(posterior.rest, self.rest)
        self.has_changed = (posterior.rest >= 0.5) != (self.rest >= 0.5)
        self.captured_ns, self.rest = posterior.captured_ns(now_ns), posterior.rest
        if self.has_changed:
            idle_s = (self.captured_ns - self.changed_ns[-1]) / SECOND_NS if self.changed_ns else 0.0
            self.changes = self.changes * math.exp(-max(idle_s, 0.0) / CHANGES_S) + 1.0
            self.changed_ns = [*self.changed_ns[1 - CHANGES_KEPT :], self.captured_ns]
            self.before_ns = [*self.before_ns[1 - CHANGES_KEPT :], last_ns]
        gain, self.information = posterior.information - self.information, posterior.information
        if gain > 0.0:
            # Between two frames it may have learned on either side.
            self.course = observed(self.course, GAIN * gain * nats_of(2.0 * (1.0 - least)), gain)

    def rest_at(self, at_ns: int) -> float | None:
        """Its rest probability at that time, 0 or 1 before its last change of side; None between two sides."""
        after = bisect_right(self.changed_ns, at_ns)
        changes = len(self.changed_ns) - after
        if changes and self.before_ns[after] < at_ns:
            return None
        return self.rest if changes == 0 else float((self.rest >= 0.5) != (changes % 2 == 1))

    def log_odds(self, rest: float, at_ns: int) -> float:
        """Nats for rest by this observer at that time, weighed by P(honest); 0 if it has just changed sides."""
        before = bisect_right(self.changed_ns, at_ns)
        if before and at_ns - self.changed_ns[before - 1] < NOTICED_S * SECOND_NS:
            return 0.0
        honest = (1.0 - BLUR) * self.honest
        p = honest * rest + (1.0 - honest) / 2.0
        return math.log(p / (1.0 - p))

    def compare(self, rest: float, others: float, at_ns: int, seconds: float) -> None:
        """Compare its rest probability with what the others say, in nats for rest, over this time."""
        is_stuck = not self.changed_ns or at_ns - self.changed_ns[-1] > STUCK_S * SECOND_NS
        q = 1.0 / (1.0 + math.exp(-others))
        nats = nats_of(2.0 * (rest * q + (1.0 - rest) * (1.0 - q)))
        share = seconds / OBSERVATION_S
        if not is_stuck:
            self.honest = observed(self.honest, nats * share, share)
        elif nats < 0.0:
            # To agree is then no merit, and each second of contradiction is an observation.
            self.honest = observed(self.honest, nats * seconds, share)


class RestPool:
    """The pooled rest over time, and the trust in each observer's rest probability; `pool` takes one step."""

    def __init__(self) -> None:
        self.contested = False
        """Whether two observers contradict each other, and nothing shows which of them is wrong."""
        self.reliability: Mapping[str, float] = {}
        """The trust, of those below TRUSTED."""
        self._voters: dict[str, _Voter] = {}
        self._sides: list[bool | None] = []
        self._trust: list[float] = []
        self._now_ns = self._at_ns = 0
        self._last = 1.0

    def pool(self, posteriors: Sequence[AgedPosterior], now_ns: int) -> float:
        """The probability that the person is at rest; while rest is contested that of before."""
        trust = self.update(posteriors, now_ns)
        if min([posterior.reliability for posterior in posteriors]) < CONTRADICTED:
            labels = [among_contradicted(posterior.reliability) for posterior in posteriors]
            trust = [own * label for own, label in zip(trust, labels, strict=True)]
        rest = pooled_rest(posteriors, trust)
        if not self.contested or abs(rest - 0.5) >= 0.5 - CLEAR_MARGIN:
            self._last = rest
        return self._last

    def update(self, posteriors: Sequence[AgedPosterior], now_ns: int) -> list[float]:
        """The trust in each posterior of this step, LEAST_TRUST to 1."""
        sides = [each.rest >= 0.5 if each.sees and each.freshness >= SIGHTED else None for each in posteriors]
        elapsed_ns = now_ns - self._now_ns
        if sides == self._sides and 0 <= elapsed_ns < REFRESH_S * SECOND_NS:
            return self._trust
        if elapsed_ns < 0:
            self._voters.clear()
            self._at_ns = 0
        self._now_ns, self._sides = now_ns, sides
        sighted = [self._noted(each, now_ns) for each, side in zip(posteriors, sides, strict=True) if side is not None]
        self.contested = False
        if len(sighted) > 1:
            self._compare(sighted)
            self._trust_in(sighted)
        self.reliability = {name: voter.trust for name, voter in self._voters.items() if voter.trust < 1.0}
        voters = [self._voters.get(posterior.observer) for posterior in posteriors]
        self._trust = [1.0 if voter is None else voter.trust for voter in voters]
        return self._trust

    def _trust_in(self, sighted: Sequence[_Voter]) -> None:
        """Compute the trust in each, and whether rest is contested."""
        believed = [voter.honest for voter in sighted] if len(sighted) > 2 else _apart(sighted[0], sighted[1])
        largest = max(believed)
        for voter, honest in zip(sighted, believed, strict=True):
            is_full = honest >= TRUSTED * min(largest, HONEST)
            voter.trust = 1.0 if is_full else max(round(honest / largest, 3), LEAST_TRUST)
        if len(sighted) == 2:
            both = sighted[0].honest * sighted[1].honest
            self.contested = both < 0.5 and min(voter.trust for voter in sighted) >= CONTRADICTED

    def _noted(self, posterior: AgedPosterior, now_ns: int) -> _Voter:
        voter = self._voters.get(posterior.observer)
        if voter is None:
            voter = _Voter(posterior.rest, posterior.information, posterior.captured_ns(now_ns))
            self._voters[posterior.observer] = voter
        voter.note(posterior, now_ns)
        return voter

    def _compare(self, voters: Sequence[_Voter]) -> None:
        """Compare what each says with what the others say since the last update."""
        at_ns, self._at_ns = self._at_ns, min(voter.captured_ns for voter in voters)
        seconds = min(max((self._at_ns - at_ns) / SECOND_NS, 0.0), 1.0)
        rests = [(voter, rest) for voter in voters if (rest := voter.rest_at(at_ns)) is not None]
        nats = [voter.log_odds(rest, at_ns) for voter, rest in rests]
        total, changes = sum(nats), [voter.changes for voter, _ in rests]
        for n, ((voter, rest), own) in enumerate(zip(rests, nats, strict=True)):
            voter.compare(rest, total - own, at_ns, seconds)
            others = sorted(changes[:n] + changes[n + 1 :]) or [0.0]
            if voter.has_changed and voter.changes > max(CHANGES_LIMIT, OFTENER * others[(len(others) - 1) // 2]):
                voter.honest = observed(voter.honest, CONTRADICTS)


def _apart(one: _Voter, two: _Voter) -> tuple[float, float]:
    """P(honest) of two observers that contradict each other: their courses show which of them is faulty."""
    both, none = one.honest * two.honest, (1.0 - one.honest) * (1.0 - two.honest)
    factor = math.exp((1.0 - both) * (log_odds_of(one.course) - log_odds_of(two.course)))
    first, second = one.honest * (1.0 - two.honest) * factor, two.honest * (1.0 - one.honest) / factor
    total = both + none + first + second
    return (both + first) / total, (both + second) / total


def pooled_rest(posteriors: Sequence[AgedPosterior], trust: Sequence[float] | None = None) -> float:
    """The probability that the person is at rest: the median weighted by freshness and trust, the mean of two.

    If no posterior is pooled, the last of observers that disappeared lately, because the network may have failed, or 1.
    trust: of each posterior, above 0 to 1; None: 1 each.
    """
    weights = [1.0] * len(posteriors) if trust is None else trust
    fresh = [posterior.rest for posterior in posteriors if posterior.freshness == 1.0 and posterior.state == "counted"]
    if fresh and len(fresh) == len(posteriors) == weights.count(1.0):
        # The usual case: all are fresh and trusted.
        return median(fresh)
    weighted = sorted(
        (posterior.rest, posterior.freshness * weight)
        for posterior, weight in zip(posteriors, weights, strict=True)
        if posterior.sees and posterior.freshness > SMALLEST
    )
    # A negligible weight would still draw the interpolation to its side.
    largest = max((weight for _, weight in weighted), default=0.0)
    # With room for round-off, so that the scale of the weights does not matter.
    weighted = [(rest, weight) for rest, weight in weighted if weight >= LEAST_SHARE * largest * (1 - 1e-9)]
    if not weighted:
        weighted = sorted((posterior.rest, 1.0) for posterior in posteriors if posterior.rest < 1.0) or [(1.0, 1.0)]
    # Each stands at the middle of its weight; between two it is interpolated.
    rests, shares = zip(*weighted, strict=True)
    middles = [reached - share / 2 for reached, share in zip(accumulate(shares), shares, strict=True)]
    # Round-off may exceed the largest.
    return float(min(np.interp(sum(shares) / 2, middles, rests), rests[-1]))
