"""What verdicts teach: whose labels are trusted, and which observers see the same. Pure.

1. A verdict that has ended is an observation of the labels of each observer (trust.py): q is the verdict's label, a the
   observer's posterior when it was decided, with "something else" as one more answer. At least three votes are needed,
   because of two that differ either may be right.
2. The distance of two posteriors (weighing.py) shows whether their observers see the same, whatever is right:
   rho = n/(n + c) exp(-mean distance / CORRELATION_SCALE). Two that are certain of the same teach nothing by it.
3. All counts are multiplied by DECAY per verdict.
4. An abstention teaches nothing. A verdict teaches once, however often it is published.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import combinations
from typing import Annotated

import numpy as np
from pydantic import Field

from common.messages import VerdictMessage
from common.vocabulary import ABSTAIN, Vocabulary
from fusion.engine.trust import LEAST_VOTES, MEMORY, honest_of, log_odds_of, nats_of, observed, returned
from fusion.engine.weighing import log_distance

DECAY = math.exp(-1.0 / MEMORY)
PRIOR_COUNT = 4.0
"""c: imagined earlier verdicts in which two observers differed as independent ones do."""
CORRELATION_SCALE = 0.1
"""Mean distance at which rho is 1/e; views 8, 30 and 90 degrees apart had distances of about .05, .15 and .25."""
UNCERTAIN_MASS = 0.1
"""Two posteriors whose mean leaves this much to other labels teach their full distance; less, in proportion."""
MIN_CORRELATION = 0.05
"""A smaller rho counts as 0."""
MIN_COUNT = 0.01
"""A smaller count, and less evidence, is dropped, so that an observer that left for good leaves no trace."""
MOST_EVIDENCE = 20.0
"""Nats; the memory of the filter keeps it below 8, so that a file with more is spoiled."""
Counts = Mapping[str, Annotated[float, Field(ge=0, allow_inf_nan=False)]]
"""The annotation is checked when counts are read from a file."""


@dataclass(frozen=True, slots=True)
class Reliability:
    """evidence: nats for the honesty of each observer's labels, beside those at the start.

    Decaying counts: times and distance per pair, under "one two". verdict: id of the last verdict that was counted.
    """

    times: Counts = field(default_factory=dict)
    distance: Counts = field(default_factory=dict)
    verdict: str = ""
    evidence: Mapping[str, Annotated[float, Field(ge=-MOST_EVIDENCE, le=MOST_EVIDENCE)]] = field(default_factory=dict)

    def honest(self, observer: str) -> float:
        """P(the labels of an observer are honest)."""
        return honest_of(self.evidence.get(observer, 0.0))

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


def learn_from_verdict(reliability: Reliability, verdict: VerdictMessage, vocabulary: Vocabulary) -> Reliability:
    """The reliability after this verdict; unchanged unless the verdict is final and new."""
    if verdict.ended_ns is None or verdict.label == ABSTAIN or verdict.id == reliability.verdict:
        return reliability
    size = vocabulary.size
    votes = {name: np.array(v.p) for name, v in verdict.votes.items() if v.p is not None and len(v.p) == size}
    honest = {name: returned(reliability.honest(name), 1.0) for name in {*reliability.evidence, *votes}}
    if len(votes) >= LEAST_VOTES and verdict.label in vocabulary.labels:
        label = vocabulary.index(verdict.label)
        for name, p in votes.items():
            overlap = (size + 1) * float(p[label]) * (1.0 - (verdict.votes[name].unlearned or 0.0))
            honest[name] = observed(honest[name], nats_of(overlap))
    nats = {name: round(log_odds_of(honest[name]), 6) for name in sorted(honest)}
    evidence = {name: own for name, own in nats.items() if abs(own) > MIN_COUNT}
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
    return Reliability(times, distance, verdict.id, evidence)


def _decayed(counts: Mapping[str, float]) -> dict[str, float]:
    return {name: count * DECAY for name, count in counts.items() if count > MIN_COUNT}
