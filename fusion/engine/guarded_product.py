"""The default rule: Bayes' product, guarded against one observer that is plainly wrong. Pure.

The design: fusion.md, "The default". N observers, M answers. Arrays may have leading axes, written `...`: one scene per
entry, each pooled by itself.

Hypothesis 0 says that every observer can be believed, hypothesis i that observer i is plainly wrong: its posterior has
nothing to do with the movement, and is left out. The result is the average over the N + 1 hypotheses,

    P(m) = sum_h P(h) P(m | h),    P(m | h) proportional to prior(m) L_h(m)^(W_h^(gamma-1)),
    L_h(m) = prod_{i not h} (p~_i(m)/prior(m))^w_ih,    p~_i = (1 - eps) p_i + eps prior.

1. P(h) is proportional to odds_h Z_h^BETA with Z_h = sum_m prior(m) L_h(m), so that doubt follows evidence: Z_0/Z_i is
   the Bayes factor of observer i's posterior against a random one, given all others. Observers that agree raise Z_0 by
   far more than the odds, and the result is their product. One that contradicts the others is left out, the more
   surely the surer it and they are. Two that differ can only doubt each other, so doubt needs three that participate.
2. w_ih = t_i / (1 + sum_j rho_ji) over the others j that h believes. t is the trust: reliability times steadiness. rho
   is the correlation: near 1 for posteriors that are the same, unless both are certain, or learned from verdicts
   (reliability.py), the latter in proportion to the participation of j.
3. W_h = (D0^2 + (sum_i w_ih D_i)^2) / (D0^2 + sum_i w_ih D_i^2), with D the divergence from the prior and D0 =
   PARTICIPATION_BITS: the effective number of observers, N if all say as much, 1 if one says nearly everything. Several
   views of one person are not independent, and with GAMMA they are right as often as they claim. W below 1 counts as 1.
4. eps bounds a veto: with one observer less, the log odds of two answers differ by at most ln(1 + M (1-eps)/eps).

An observer whose posterior is the prior does not participate and changes nothing. All of this changes smoothly with the
number of participants. Averaging over which observation is an outlier: Box and Tiao, "A Bayesian approach to some
outlier problems", Biometrika 55, 1968. The constants were chosen on people left out one at a time.

`guarded_weights`, mixed by rules.py:averaged_log_mix, is the plain form; joint posteriors are pooled by it.
guarded_pool.py gives the same for movements alone in a third of the time.
"""

from functools import cache

import numpy as np

from common.probability import Floats
from fusion.engine.weighing import (
    PARTICIPATION_BITS,
    ObserverTrust,
    PoolingWeights,
    divergence_from_prior,
    off_diagonal,
    shares_of,
    similarity,
    sum_last,
    uncertainty,
)

EPSILON = 0.02
"""eps: share of the prior in p~."""
FAULT_PROBABILITY = (0.05, 0.3)
"""Prior probability that an observer is plainly wrong, for three, and for four and more participants.

Two of three agree by mistake more often than three of four.
"""
ODDS_OF_THREE, ODDS_OF_FOUR = (probability / (1.0 - probability) for probability in FAULT_PROBABILITY)
GAMMA = 0.45
"""Chosen with BETA and FAULT_PROBABILITY: with this exponent, the result is right as often as it claims."""
BETA = 2.0
"""The evidence for a hypothesis counts twice, because an honest observer is rarely both sure and contradicted."""
EXPONENT_LIMIT = 500.0
"""Nats; far beyond the log Bayes factor of some tens of observers. It keeps the exponential finite."""


def guarded_weights(p: Floats, prior: Floats, observers: ObserverTrust) -> PoolingWeights:
    """(..., N, M) posteriors, (M,) prior -> exponents (..., H, N) and probabilities of H hypotheses: N + 1, or 1."""
    ratio = p * (1.0 / prior)
    divergence_bits = divergence_from_prior(p, ratio)
    participation = np.minimum(divergence_bits / PARTICIPATION_BITS, 1.0)
    believed = believed_by(p.shape[-2])
    # Row j, column i: the correlation by which observer i loses weight to observer j.
    rho = np.maximum(similarity(ratio) * uncertainty(p), observers.correlations * participation[..., :, None])
    w = believed * observers.trust[..., None, :] / (1.0 + believed @ rho)
    hypotheses = _hypotheses(w, ratio, prior, participation)
    exponents = w * np.maximum(_effective_number(w, divergence_bits), 1.0)[..., None] ** (GAMMA - 1.0)
    mean_exponents = (hypotheses[..., None, :] @ exponents)[..., 0, :]
    return PoolingWeights(
        exponents, np.full(p.shape[:-1], EPSILON), shares_of(mean_exponents * divergence_bits), hypotheses
    )


def _effective_number(w: Floats, divergence_bits: Floats) -> Floats:
    """W of each hypothesis (3), (..., H); 1 if no observer participates. w (..., H, N)."""
    information = w * divergence_bits[..., None, :]
    squares = (information @ divergence_bits[..., None])[..., 0]
    number: Floats = (sum_last(information) ** 2 + PARTICIPATION_BITS**2) / (squares + PARTICIPATION_BITS**2)
    return number


def _hypotheses(w: Floats, ratio: Floats, prior: Floats, participation: Floats) -> Floats:
    """P(h) of each hypothesis (1), (..., H). ratio: p/prior."""
    participants = sum_last(participation)
    if w.shape[-2] == 1:
        return np.ones((*participants.shape, 1))
    log_likelihood = w @ np.log((1.0 - EPSILON) * ratio + EPSILON)
    largest = np.maximum.reduce(log_likelihood, axis=-1)
    log_z = np.log(np.exp(log_likelihood - largest[..., None]) @ prior) + largest
    odds = ODDS_OF_THREE * np.minimum(np.maximum(participants - 2.0, 0.0), 1.0)
    odds = odds + (ODDS_OF_FOUR - ODDS_OF_THREE) * np.minimum(np.maximum(participants - 3.0, 0.0), 1.0)
    mass = np.exp(np.minimum(BETA * (log_z - log_z[..., :1]), EXPONENT_LIMIT))
    mass[..., 1:] *= odds[..., None] * participation
    hypotheses: Floats = mass / sum_last(mass)[..., None]
    return hypotheses


@cache
def believed_by(size: int) -> Floats:
    """(H, N): 1 for an observer that the hypothesis believes. Fewer than three observers leave only hypothesis 0."""
    none_wrong = np.ones((1, size))
    return none_wrong if size < 3 else np.concatenate([none_wrong, off_diagonal(size)])
