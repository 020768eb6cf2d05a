"""Reliability and correlations of the observers, learned from verdicts, and the steadiness of each. Pure.

1. When a movement has ended, each observer with a vote had given the verdict's label some probability, "something else"
   being one more answer. If it was right as often as it claimed, that is on average the sum of its squared
   probabilities. Reliability is ((right + c) / (claimed + c))^2 over both sums, at most 1: an honestly unsure observer
   loses nothing, a sure and wrong one does, also if it is sure of something else. At least three votes are needed,
   because of two that differ either may be right.
   Such a movement is also evidence whether what the observer publishes has anything to do with the movement at all. Of
   R answers, a(label) is likelier than a random answer by the factor R a(label), blurred to g = (1-b) R a(label) + b.
   With E the sum of ln g, from LEAST_EVIDENCE to MOST_EVIDENCE, reliability is multiplied by (1 + odds) / (1 + odds
   exp(-E)), at most 1: P(not plainly wrong) over its value at the start, with the odds of guarded_product.py. Three
   movements expose a liar; an observer that agreed before can afford one error more.
2. The distance of two posteriors (weighing.py) shows whether their observers see the same, whatever is right:
   rho = n/(n + c) exp(-mean distance / CORRELATION_SCALE). Two that are certain of the same teach nothing by it.
3. All counts are multiplied by DECAY per verdict, so that an observer that agrees again is relied on again after about
   twenty.
4. A majority may be wrong, and must not silence the one that is right for good: rule 1 counts down to MIN_RATIO, and
   E has a limit, so that five or six movements in which an observer agrees with the others restore most of its voice.
5. An abstention teaches nothing. A verdict teaches once, however often it is published.
6. Steadiness needs no verdict: a posterior is cumulative, and the next one, a frame later, follows from it. o = sum_m
   p(m) p'(m)/prior(m) is the Bayes factor of the next posterior if the last one was right, against a random one.
   Steadiness is the mean of min(o, 1)^2 over the last STEADY_S, in the logarithm. Posteriors of real observers stay at
   1, also from one movement into the next; one that jumps about falls to .1 within a few frames. What counts is the
   steadiness over that of the steadiest observer, because a change that all see at once is no contradiction. At 3 to
   6 messages a second a posterior may change by much in one of them: o is at least SLOW_OVERLAP, the mean is over
   STEADY_MESSAGES, and STEADY_ENOUGH of the steadiest is enough.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Annotated

import numpy as np
from pydantic import Field

from common.messages import VerdictMessage
from common.probability import Floats
from common.vocabulary import ABSTAIN, Vocabulary
from fusion.engine.guarded_product import ODDS_OF_THREE
from fusion.engine.weighing import log_distance

DECAY = 0.95
PRIOR_COUNT = 4.0
"""c: imagined earlier verdicts in which the observer was as reliable and independent as it claimed."""
MIN_RATIO, MIN_RELIABILITY = 0.1, 0.001
BLUR = 0.1
"""b: a calibrated observer is now and then sure and wrong."""
LEAST_EVIDENCE, MOST_EVIDENCE = -8.0, 3.0
"""Nats."""
CORRELATION_SCALE = 0.1
"""Mean distance at which rho is 1/e; views 8, 30 and 90 degrees apart had distances of about .05, .15 and .25."""
UNCERTAIN_MASS = 0.1
"""Two posteriors whose mean leaves this much to other labels teach their full distance; less, in proportion."""
MIN_CORRELATION = 0.05
"""A smaller rho counts as 0."""
MIN_COUNT = 0.01
"""A smaller count is dropped, so that an observer that left for good leaves no trace."""
STEADY_S, STEADY_MESSAGES = 0.25, 8
SHORT_GAP_S, STEADY_GAP_S = 0.15, 0.35
"""Posteriors further apart than the first may differ for once, further than the second also for good."""
STEADY_ENOUGH = 0.6
"""Of posteriors further apart than SHORT_GAP_S: those of recorded people stay above at 4 Hz."""
LEAST_OVERLAP, SLOW_OVERLAP = 0.01, 0.3
Counts = Mapping[str, Annotated[float, Field(ge=0, allow_inf_nan=False)]]
"""The annotation is checked when counts are read from a file."""


@dataclass(frozen=True, slots=True)
class Reliability:
    """Decaying counts: right and claimed per observer; times and distance per pair, under "one two".

    verdict: id of the last verdict that was counted. evidence: E of each observer.
    """

    right: Counts = field(default_factory=dict)
    claimed: Counts = field(default_factory=dict)
    times: Counts = field(default_factory=dict)
    distance: Counts = field(default_factory=dict)
    verdict: str = ""
    evidence: Mapping[str, Annotated[float, Field(ge=LEAST_EVIDENCE, le=MOST_EVIDENCE)]] = field(default_factory=dict)

    def reliability(self, observer: str) -> float:
        """How far to rely on an observer: MIN_RELIABILITY to 1."""
        right, claimed = self.right.get(observer, 0.0), self.claimed.get(observer, 0.0)
        ratio = (right + PRIOR_COUNT) / (claimed + PRIOR_COUNT)
        believed = (1.0 + ODDS_OF_THREE) / (1.0 + ODDS_OF_THREE * math.exp(-self.evidence.get(observer, 0.0)))
        return round(max(MIN_RELIABILITY, min(max(ratio**2, MIN_RATIO), 1.0) * min(believed, 1.0)), 3)

    def correlations(self, observer: str) -> dict[str, float]:
        """rho with each correlated observer, MIN_CORRELATION to 1."""
        result = {}
        for pair, times in self.times.items():
            one, _, two = pair.partition(" ")
            if observer in (one, two) and times > 0:
                mean_distance = self.distance.get(pair, times) / times
                rho = times / (times + PRIOR_COUNT) * float(np.exp(-mean_distance / CORRELATION_SCALE))
                if rho >= MIN_CORRELATION:
                    result[two if observer == one else one] = round(rho, 3)
        return result


def steadiness_after(steadiness: float, last: Floats, new: Floats, seconds: float) -> float:
    """The steadiness, above 0 to 1, once a posterior follows the last one after `seconds` (6); both (R,) answers."""
    return steadiness_after_overlap(steadiness, len(last) * float(last @ new), seconds)


def information_of(p: Sequence[float], unlearned: float | None) -> float:
    """How much a posterior (M,) knows about the movement: 0 if it is uniform, or of something else; 1 if it is sure."""
    certainty = math.log(max(len(p) * max(p), 1.0)) / math.log(len(p)) if len(p) > 1 else 0.0
    return certainty * (1.0 - (unlearned or 0.0))


def overlap_of(p: Floats, unlearned: float | None, q: Floats, unlearned_q: float | None) -> float:
    """o of (6) for two posteriors (M,) with the probability of something else, None if the observer cannot tell."""
    answers = len(p) + 1
    u = 1.0 / answers if unlearned is None else unlearned
    v = 1.0 / answers if unlearned_q is None else unlearned_q
    return answers * ((1.0 - u) * (1.0 - v) * float(p.dot(q)) + u * v)


def steadiness_after_overlap(steadiness: float, overlap: float, seconds: float) -> float:
    """The same of o, the Bayes factor in (6) by which the new posterior is likelier if the last one was right."""
    if not 0.0 < seconds <= STEADY_GAP_S or (overlap >= 1.0 and steadiness == 1.0):
        return steadiness
    # A posterior may change as much as this in a long gap: only one that does so again and again contradicts itself.
    overlap = min(max(overlap, LEAST_OVERLAP if seconds <= SHORT_GAP_S else SLOW_OVERLAP), 1.0)
    memory_s = STEADY_S if seconds <= SHORT_GAP_S else STEADY_MESSAGES * seconds
    return float(steadiness * (overlap**2 / steadiness) ** (1.0 - math.exp(-seconds / memory_s)))


def steady_enough(seconds: float) -> float:
    """Which share of the greatest steadiness is full steadiness, for posteriors so many seconds apart."""
    return 1.0 if seconds <= SHORT_GAP_S else STEADY_ENOUGH


def learn_from_verdict(reliability: Reliability, verdict: VerdictMessage, vocabulary: Vocabulary) -> Reliability:
    """The reliability after this verdict; unchanged unless the verdict is final and new."""
    if verdict.ended_ns is None or verdict.label == ABSTAIN or verdict.id == reliability.verdict:
        return reliability
    size = vocabulary.size
    votes = {name: np.array(v.p) for name, v in verdict.votes.items() if v.p is not None and len(v.p) == size}
    right, claimed = _decayed(reliability.right), _decayed(reliability.claimed)
    evidence = {name: nats for name, nats in reliability.evidence.items() if name in claimed}
    if len(votes) >= 3 and verdict.label in vocabulary.labels:
        label = vocabulary.index(verdict.label)
        for name, p in votes.items():
            unlearned = verdict.votes[name].unlearned or 0.0
            answers = np.append(p * (1.0 - unlearned), unlearned)
            right[name] = right.get(name, 0.0) + float(answers[label])
            claimed[name] = claimed.get(name, 0.0) + float(answers @ answers)
            gain = math.log((1.0 - BLUR) * len(answers) * float(answers[label]) + BLUR)
            evidence[name] = min(max(evidence.get(name, 0.0) + gain, LEAST_EVIDENCE), MOST_EVIDENCE)
    times, distance = _decayed(reliability.times), _decayed(reliability.distance)
    # (N, M) -> (N, N), of all pairs at once.
    voters = sorted(votes)
    distances = log_distance(np.array([votes[name] for name in voters]) * size).tolist() if len(voters) > 1 else []
    for (n, one), (k, two) in combinations(enumerate(voters), 2):
        p, q = votes[one], votes[two]
        weight = min(1.0, (1.0 - float((p + q).max()) / 2) / UNCERTAIN_MASS)
        pair = f"{one} {two}"
        times[pair] = times.get(pair, 0.0) + weight
        distance[pair] = distance.get(pair, 0.0) + weight * distances[n][k]
    return Reliability(right, claimed, times, distance, verdict.id, evidence)


def _decayed(counts: Mapping[str, float]) -> dict[str, float]:
    return {name: count * DECAY for name, count in counts.items() if count > MIN_COUNT}
