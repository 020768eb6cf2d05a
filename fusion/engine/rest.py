"""Whether the person rests, decided by observers of which one may be wrong, stuck or hostile. Pure: time is passed in.

1. The pooled rest is the median over the observers whose posterior is pooled, each weighted by its freshness and its
   trust in this question. The rule's weights play no part: an observer that cannot tell two movements apart still sees
   that the person moves.
2. An observer loses trust that changes sides more often than people do (CHANGES_LIMIT in WINDOW_S), that has not
   changed sides while the others did, or that is on another side than most of the others for much of the time.
3. Rules 2 and 3 compare with the others; of several others the lower median counts, so that one of them cannot take
   trust from anybody. Of two observers that differ only these signs tell which is wrong.
4. If no observer is pooled, the rest of those that went lately holds a little longer, because the network may have
   failed; long silence of all is rest.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field

from common import SECOND_NS
from fusion.engine.roster import POOLED_STATES, AgedPosterior

LEAST_FRESHNESS = 1e-9
"""An observer with less left of its opinion has no vote on rest."""
LEAST_SHARE = 0.1
"""A vote with less of the largest weight is left out."""
SIGHTED = 0.2
"""The least freshness of an observer with which others are compared."""
WINDOW_S = 3.0
CHANGES_KEPT = 32
CHANGES_LIMIT = 6
"""Observers of recorded people change sides up to eight times in three seconds, seldom more than six."""
STUCK_S, MISSED = 6.0, 4
"""An observer that changed sides before is stuck after so long, and so many changes of the others."""
DISSENT_S = 8.0
USUAL_DISSENT, DISSENT_RANGE = 0.25, 0.25
"""Observers of recorded people differ from one another in 6 to 12 % of the time."""
LEAST_TRUST = 0.05


@dataclass(slots=True)
class _Course:
    """One observer: its side, when it changed it (newest last), and how much it differed from the others lately."""

    rests: bool
    changed_ns: list[int] = field(default_factory=list)
    dissent: float = 0.0

    def note(self, rests: bool, now_ns: int) -> None:
        if rests != self.rests:
            self.rests = rests
            self.changed_ns = [*self.changed_ns[1 - CHANGES_KEPT :], now_ns]

    def changes_since(self, since_ns: int) -> int:
        return len(self.changed_ns) - bisect_right(self.changed_ns, since_ns)


class RestTrust:
    """The trust in each observer's word on rest; `update` takes one step."""

    def __init__(self) -> None:
        self._courses: dict[str, _Course] = {}
        self._now_ns = 0

    def update(self, posteriors: Sequence[AgedPosterior], now_ns: int) -> list[float]:
        """The trust in each posterior of this step, LEAST_TRUST to 1."""
        if now_ns < self._now_ns:
            self._courses.clear()
        elapsed_s, self._now_ns = (now_ns - self._now_ns) / SECOND_NS, now_ns
        sighted = {one.observer: one.rest >= 0.5 for one in posteriors if _is_sighted(one)}
        for observer, rests in sighted.items():
            self._courses.setdefault(observer, _Course(rests)).note(rests, now_ns)
        share = 1.0 - math.exp(-min(elapsed_s, 1.0) / DISSENT_S)
        return [self._trust(one.observer, sighted, now_ns, share) for one in posteriors]

    def _trust(self, observer: str, sighted: dict[str, bool], now_ns: int, share: float) -> float:
        course = self._courses.get(observer)
        others = [self._courses[name] for name in sighted if name != observer]
        if course is None or not others:
            return 1.0
        changes = course.changes_since(now_ns - round(WINDOW_S * SECOND_NS))
        trust = min(1.0, CHANGES_LIMIT / max(changes, 1)) ** 3
        trust *= self._liveliness(course, others, now_ns)
        resting = sum(other.rests for other in others)
        if len(others) > 1 and observer in sighted and 2 * resting != len(others):
            differs = course.rests != (2 * resting > len(others))
            course.dissent += (differs - course.dissent) * share
        trust *= 1.0 - max(course.dissent - USUAL_DISSENT, 0.0) / DISSENT_RANGE
        return max(trust, LEAST_TRUST)

    def _liveliness(self, course: _Course, others: Sequence[_Course], now_ns: int) -> float:
        """Half for each change of the others that this observer has not made, if it is no matter of timing."""
        last_ns = course.changed_ns[-1] if course.changed_ns else None
        missed = sorted(other.changes_since(last_ns or 0) for other in others)[(len(others) - 1) // 2]
        if last_ns is None:
            return 0.5**missed
        is_stuck = missed > MISSED and now_ns - last_ns > STUCK_S * SECOND_NS
        return 0.5 ** (missed - MISSED) if is_stuck else 1.0


def pooled_rest(posteriors: Sequence[AgedPosterior], trust: Sequence[float] | None = None) -> float:
    """The probability that the person is at rest: the weighted median (1), the mean of two. trust: 1 each if None."""
    weights = [1.0] * len(posteriors) if trust is None else trust
    votes = sorted(
        (one.rest, one.freshness * weight)
        for one, weight in zip(posteriors, weights, strict=True)
        if one.state in POOLED_STATES and one.freshness > LEAST_FRESHNESS
    )
    # One that hardly counts would still draw the interpolation to its side.
    most = max((weight for _, weight in votes), default=0.0)
    votes = [vote for vote in votes if vote[1] >= LEAST_SHARE * most]
    if not votes:
        votes = sorted((one.rest, 1.0) for one in posteriors if one.rest < 1.0) or [(1.0, 1.0)]
    # Each vote stands at the middle of its weight; between two votes the result is interpolated. Plain Python, because
    # there are few observers.
    half, before = sum(weight for _, weight in votes) / 2, 0.0
    last_rest, last_middle = votes[0][0], 0.0
    for rest, weight in votes:
        middle = before + weight / 2
        if middle >= half:
            return last_rest + (rest - last_rest) * (half - last_middle) / (middle - last_middle)
        last_rest, last_middle, before = rest, middle, before + weight
    return last_rest


def _is_sighted(posterior: AgedPosterior) -> bool:
    return posterior.state in POOLED_STATES and posterior.freshness >= SIGHTED
