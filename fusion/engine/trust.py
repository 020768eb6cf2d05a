"""How far each observer is trusted: one filter for all channels. Pure.

The design: fusion.md, "Trust". An observer is honest or faulty, on each channel by itself: its labels, its rest
probability, and its course over time. The state is hidden, and a hidden Markov model of two states follows it, after
Dawid and Skene, "Maximum likelihood estimation of observer error-rates using the EM algorithm", Applied Statistics 28,
1979, who estimate from the answers of several observers alone who of them errs.

1. P(honest) is 1 - FAULT at the start. An observation shows a, a distribution over R answers, where q is what others
   say. A faulty observer's answer has nothing to do with q, an honest one's for a share BLUR, so that

       g = P(a | q, honest) / P(a | faulty) = (1 - BLUR) R sum_r a(r) q(r) + BLUR.

2. Between observations the state may change: P(honest) goes back to 1 - FAULT with MEMORY independent observations, so
   that no observer is condemned, or beyond doubt, for ever.
3. What is read is trust: P(honest) over that at the start, or over that of the observers beside it, at most 1, because
   what all do is no fault.

The channels differ in a, q, and what one independent observation is:

| channel | a | q | one observation |
|---|---|---|---|
| label | its posterior at the decision | the label of the verdict | a movement (reliability.py) |
| | its posterior after it | the label decided | MOVEMENT_S (roster.py) |
| time | its posterior | its own last one | a message that contradicts, a second |
| rest | rest or motion | what the others say, each as far as it is trusted | OBSERVATION_S (rest_trust.py) |
"""

import math
from collections.abc import Sequence

from common.probability import Floats

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
LEAST = 0.001
"""The least trust; votes have three digits of it."""
HONEST = 1.0 - FAULT
AGREES = math.log(2.0 - BLUR)
CONTRADICTS = math.log(BLUR)
"""Nats: ln g of an observation with two answers, if q is certain."""


def nats_of(overlap: float) -> float:
    """ln g (1) of an observation whose overlap R sum a q is so much: 1 for a random answer, R for the very same."""
    return math.log((1.0 - BLUR) * overlap + BLUR)


def returned(honest: float, observations: float) -> float:
    """P(honest) after so many observations in which nothing was learned (2)."""
    return HONEST + (honest - HONEST) * math.exp(-observations / MEMORY)


def observed(honest: float, nats: float) -> float:
    """P(honest) after an observation of so many nats for honesty (1)."""
    likelihood = honest * math.exp(nats)
    return likelihood / (likelihood + 1.0 - honest)


def log_odds_of(honest: float) -> float:
    """Nats for honesty beside those at the start; what is written to files."""
    return math.log(honest / (1.0 - honest)) - math.log(HONEST / FAULT)


def honest_of(log_odds: float) -> float:
    """The inverse of `log_odds_of`."""
    return observed(HONEST, log_odds)


def overlap_of(a: Floats, q: Floats) -> float:
    """R sum a q of two distributions (R,)."""
    return len(a) * float(a.dot(q))


def after_message(honest: float, overlap: float, seconds: float) -> float:
    """P(honest) on the time channel once a posterior follows the last one after `seconds`.

    A posterior is cumulative, and the next one follows from it. To agree with oneself is no merit, so that this shows
    no more than an answer of two.
    """
    share = min(max(seconds, 0.0), 1.0)
    nats = nats_of(overlap) if overlap < 1.0 else 0.0
    return observed(returned(honest, share), nats + share * AGREES)


def after_decision(honest: float, overlap: float, seconds: float) -> float:
    """P(honest) of the labels once an observer has said so of the label decided for so many seconds."""
    share = seconds / MOVEMENT_S
    return observed(returned(honest, share), share * min(nats_of(overlap), AGREES))


def information_of(p: Sequence[float], unlearned: float | None) -> float:
    """How much a posterior (M,) knows about the movement: 0 if it is uniform, or of something else; 1 if it is sure."""
    certainty = math.log(max(len(p) * max(p), 1.0)) / math.log(len(p)) if len(p) > 1 else 0.0
    return certainty * (1.0 - (unlearned or 0.0))


def published_trust(honest: float, steady: float, usual: float) -> float:
    """The trust in the labels of an observer, as votes have it (3).

    honest: P(honest) on the label channel; steady: on the time channel; usual: that of most observers.
    """
    behind = max(min(usual, HONEST) - steady, 0.0)
    trust = min(honest / HONEST, 1.0) * (1.0 - behind / HONEST)
    return 1.0 if trust >= TRUSTED else max(round(trust, 3), LEAST)
