"""How far each observer is trusted: one filter for all channels, and what verdicts teach (fusion.md, "Trust"). Pure.

An observer is honest or faulty, on each channel by itself: its labels, its rest probability, and its course over time.
A hidden Markov model of two states follows it: `observed`. What is read is trust: P(honest) over that at the start, or
over that of the observers beside it, at most 1, because what all do is no fault.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from pydantic import Field

from common.message_types import CONTRADICTED
from common.messages import VerdictMessage
from common.probability import Floats
from common.vocabulary import ABSTAIN, Vocabulary

FAULT = 0.1
"""Probability that an observer is faulty before anything is known: one movement in which it is sure of another label
than the others then leaves a trust of .5, and the least that honest people's observers gave to a verdict's label (.064
of 390 at 10 Hz) one of .84."""
BLUR = 0.05
"""Share of an honest observer's answers that have nothing to do with what others say."""
MEMORY = 20.0
"""Independent observations after which 1/e of what was known is left."""
OBSERVATION_S = 3.0
"""Seconds in which what lasts is observed once: honest observers differ about rest for up to 1.7 s on end."""
MOVEMENT_S = 2.0
"""Seconds of a movement after its decision that are one observation: those of recorded people last 1.5 to 3.5 s."""
LEAST_VOTES = 3
"""Of two that differ either may be right."""
TRUSTED = 0.9
"""Trust of this or more is full trust: honest observers differ by so much."""
LEAST_TRUST = 0.001
"""The least trust; votes have three digits of it."""
HONEST = 1.0 - FAULT
AGREES = math.log(2.0 - BLUR)
CONTRADICTS = math.log(BLUR)
"""Nats: ln g of an observation with two answers, if q is certain."""
LEAST_NATS = 0.01
"""Less evidence is dropped, so that an observer that left for good leaves no trace."""


def nats_of(overlap: float) -> float:
    """ln g of an observation a, a distribution over R answers, where others say q; overlap: R sum a q.

    g = P(a | q, honest) / P(a | faulty) = (1 - BLUR) R sum a q + BLUR: a faulty observer's answer has nothing to do
    with q, an honest one's for a share BLUR.
    """
    return math.log((1.0 - BLUR) * overlap + BLUR)


def observed(honest: float, nats: float, observations: float = 0.0) -> float:
    """P(honest) after an observation of so many nats for honesty, which counts as so many independent ones.

    Between observations the state may change: P(honest) goes back to HONEST with MEMORY of them, so that no observer is
    condemned, or beyond doubt, for ever.
    """
    before = HONEST + (honest - HONEST) * math.exp(-observations / MEMORY)
    likelihood = before * math.exp(nats)
    return likelihood / (likelihood + 1.0 - before)


def log_odds_of(honest: float) -> float:
    """Nats for honesty beside those at the start, which `observed` with HONEST turns back; what is written to files."""
    return math.log(honest / (1.0 - honest)) - math.log(HONEST / FAULT)


def among_contradicted(trust: float) -> float:
    """The factor on the weight of an observer that is named on another channel, because it may be hostile."""
    return min(trust / CONTRADICTED, 1.0)


def odds_of_fault(trust: float) -> float:
    """The odds that an observer with this trust is faulty, over those at the start, when trust is 1."""
    return (1.0 / (HONEST * trust) - 1.0) * HONEST / FAULT


def overlap_of(a: Floats, q: Floats) -> float:
    """R sum a q of two distributions (R,)."""
    return len(a) * float(a.dot(q))


def after_message(honest: float, overlap: float, seconds: float) -> float:
    """P(honest) on the time channel once a posterior follows the last one after `seconds`.

    A posterior is cumulative, and the next one follows from it. To agree with oneself is no merit, so that this shows
    no more than an answer of two.
    """
    share, nats = min(max(seconds, 0.0), 1.0), nats_of(overlap) if overlap < 1.0 else 0.0
    return observed(honest, nats + share * AGREES, share)


def after_decision(honest: float, overlap: float, seconds: float) -> float:
    """P(honest) of an observer's labels after it has held this opinion of the decided label for `seconds`."""
    share = seconds / MOVEMENT_S
    return observed(honest, share * min(nats_of(overlap), AGREES), share)


def published_trust(honest: float, steady: float, usual: float) -> float:
    """The trust in the labels of an observer, as votes have it.

    honest: P(honest) on the label channel; steady: on the time channel; usual: that of most observers.
    """
    behind = max(min(usual, HONEST) - steady, 0.0)
    trust = min(honest / HONEST, 1.0) * (1.0 - behind / HONEST)
    return 1.0 if trust >= TRUSTED else max(round(trust, 3), LEAST_TRUST)


@dataclass(frozen=True, slots=True)
class Reliability:
    """evidence: nats for the honesty of each observer's labels, beside those at the start; checked when it is read from
    a file: the filter remembers MEMORY observations, and never reaches 8. verdict: id of the last one counted."""

    verdict: str = ""
    evidence: Mapping[str, Annotated[float, Field(ge=-MEMORY, le=MEMORY)]] = field(default_factory=dict)

    def honest(self, observer: str) -> float:
        """P(the labels of an observer are honest)."""
        return observed(HONEST, self.evidence.get(observer, 0.0))

    def proves(self, observer: str) -> bool:
        """Whether its labels have agreed with verdicts more than they have contradicted them."""
        return self.evidence.get(observer, 0.0) > 0.0


def learn_from_verdict(reliability: Reliability, verdict: VerdictMessage, vocabulary: Vocabulary) -> Reliability:
    """The reliability after this verdict; unchanged unless the verdict is final and new, and no abstention."""
    if verdict.ended_ns is None or verdict.label == ABSTAIN or verdict.id == reliability.verdict:
        return reliability
    size = vocabulary.size
    votes = {name: v.p for name, v in verdict.votes.items() if v.p is not None and len(v.p) == size}
    nats = dict.fromkeys({*reliability.evidence, *votes}, 0.0)
    if len(votes) >= LEAST_VOTES and verdict.label in vocabulary.labels:
        label = vocabulary.index(verdict.label)
        for name, p in votes.items():
            nats[name] = nats_of((size + 1) * p[label] * (1.0 - (verdict.votes[name].unlearned or 0.0)))
    log_odds = {n: round(log_odds_of(observed(reliability.honest(n), nats[n], 1.0)), 6) for n in sorted(nats)}
    return Reliability(verdict.id, {name: own for name, own in log_odds.items() if abs(own) > LEAST_NATS})
