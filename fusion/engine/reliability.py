"""What verdicts teach of the judges: who can be relied on, and who sees with the same eyes as another. Pure.

1. When a movement has ended, each judge who was heard had claimed to be right with the probability of his likeliest
   label, and was or was not, as far as the verdict knows. Reliability is ((right + c) / (claimed + c))^2, at most 1:
   who says honestly how unsure he is loses nothing, who is sure and wrong does. At least three must have been heard:
   where two differ nobody knows which of them is right.
2. How far the beliefs of two were apart (strengths.py) tells whether they see with the same eyes, whatever is right:
   rho = n/(n + c) exp(-mean distance / ALIKE). Two who are certain of the same teach nothing by it.
3. All counts are multiplied by KEEPS with each verdict, so that who agrees again is relied on again within some
   twenty.
4. Reliability never falls below LEAST: a majority may be wrong, and must not silence for ever the one who is right.
5. An abstention teaches nothing. A verdict teaches once, however often it is said.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import combinations
from typing import Annotated

import numpy as np
from pydantic import Field

from common.messages import VerdictMessage
from common.vocabulary import ABSTAIN, Vocabulary
from fusion.engine.strengths import log_distance

KEEPS = 0.95
FIRST = 4.0
"""c: as many verdicts in which all was well are supposed to have been."""
LEAST = 0.1
ALIKE = 0.1
"""Mean distance at which two share 1/e of a voice; views 8, 30, 90 degrees apart were some .05, .15, .25 apart."""
UNSURE = 0.1
"""Two whose mean belief leaves so much to other labels teach whole how far they are apart; less, in proportion."""
SLIGHT = 0.05
"""A smaller rho is none."""
NOTHING = 0.01
"""A smaller count is forgotten: who has gone for good leaves no trace."""
Counts = Mapping[str, Annotated[float, Field(ge=0, allow_inf_nan=False)]]
"""Checked where they come from a file."""


@dataclass(frozen=True, slots=True)
class Reliability:
    """Counts that slowly forget: right and claimed of each observer; times and distance of pairs, by "one two"."""

    right: Counts = field(default_factory=dict)
    claimed: Counts = field(default_factory=dict)
    times: Counts = field(default_factory=dict)
    distance: Counts = field(default_factory=dict)
    verdict: str = ""

    def reliability(self, observer: str) -> float:
        """How far to rely on him: LEAST to 1."""
        right, claimed = self.right.get(observer, 0.0), self.claimed.get(observer, 0.0)
        return round(min(1.0, max(LEAST, ((right + FIRST) / (claimed + FIRST)) ** 2)), 3)

    def correlations(self, observer: str) -> dict[str, float]:
        """With whom he shares a voice, and how much of it, 0 to 1."""
        found = {}
        for pair, times in self.times.items():
            one, _, two = pair.partition(" ")
            if observer in (one, two) and times > 0:
                rho = times / (times + FIRST) * float(np.exp(-self.distance.get(pair, times) / times / ALIKE))
                if rho >= SLIGHT:
                    found[two if observer == one else one] = round(rho, 3)
        return found


def learn_from_verdict(reliability: Reliability, verdict: VerdictMessage, vocabulary: Vocabulary) -> Reliability:
    """The reliability with this verdict's, if it is the last word on its movement and new."""
    if verdict.ended_ns is None or verdict.label == ABSTAIN or verdict.id == reliability.verdict:
        return reliability
    size = vocabulary.size
    beliefs = {name: np.array(v.p) for name, v in verdict.votes.items() if v.p is not None and len(v.p) == size}
    right, claimed = dict(_faded(reliability.right)), dict(_faded(reliability.claimed))
    if len(beliefs) >= 3 and verdict.label in vocabulary.labels:
        label = vocabulary.index(verdict.label)
        for name, p in beliefs.items():
            likeliest = int(p.argmax())
            # Who knows nothing holds no label, and claims to be right as often as chance has it.
            by_chance = np.ptp(p) < 1e-6
            right[name] = right.get(name, 0.0) + (1.0 / size if by_chance else float(likeliest == label))
            claimed[name] = claimed.get(name, 0.0) + float(p[likeliest])
    times, distance = dict(_faded(reliability.times)), dict(_faded(reliability.distance))
    for (one, p), (two, q) in combinations(sorted(beliefs.items()), 2):
        weight = min(1.0, (1.0 - float((p + q).max()) / 2) / UNSURE)
        pair = f"{one} {two}"
        times[pair] = times.get(pair, 0.0) + weight
        distance[pair] = distance.get(pair, 0.0) + weight * float(log_distance(np.array([p, q]) * size)[0, 1])
    return Reliability(right, claimed, times, distance, verdict.id)


def _faded(counts: Mapping[str, float]) -> Iterable[tuple[str, float]]:
    return ((name, count * KEEPS) for name, count in counts.items() if count > NOTHING)
