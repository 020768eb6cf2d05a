"""The rule `robust_inverse_entropy`: how each observer counts. Pure.

The design: fusion.md, "robust_inverse_entropy". N observers, M movements. Arrays may have leading axes, written `...`:
one scene per entry, each weighed by itself.

Observer i adds w_i ln(p~_i/prior) to the pooled log posterior, with p~_i = (1 - eps_i) p_i + eps_i prior and
w_i = c_i s_i r_i t_i / d_i . W^(gamma-1):

1. c: certainty. The inverse entropy of p~_i, divided by its mean over the participating observers, at most CAP.
2. s: limit on being surer than the others. The divergence of p_i from the prior, in bits, counts up to SURER times
   that of the next surest observer, because all of them see the same movement at the same time.
3. r = min(1, o)^2: agreement with the others. o = sum_m q(m) p_i(m)/prior(m), where q is the others' pooled
   posterior, is the Bayes factor of p_i against a random one. It lowers a contradicted observer and raises none.
4. eps: the probability that the observer is plainly wrong, updated by o: eps_i = eps / (eps + (1-eps) o).
5. t: trust, which is reliability times steadiness (reliability.py), at most 1.
6. d_i = 1 + sum_j rho_ij a_j r_j: correlated observers share one weight. a_j, 0 to 1, is how far observer j
   participates; rho comes from similar posteriors, unless both are certain, or from earlier verdicts (reliability.py).
7. W = sum_i w_i a_i before this factor, if above 1: several views of one person are not independent.

Rules 2 to 4 need three participating observers, because two can only doubt each other; eps grows with their number for
the same reason. An observer whose posterior is the prior does not participate. All of this changes smoothly with the
number of participants. The constants were chosen by hand, on posteriors learned without the person they are about.
"""

import numpy as np

from common.probability import SMALLEST, Floats
from fusion.engine.weighing import (
    ENTROPY_FLOOR_BITS,
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

ROBUSTNESS = (0.01, 0.05, 0.2)
"""eps for one, two, and three or more participants, linear in between."""
OTHERS_EPSILON = 0.2
"""eps of the others in rule 3."""
ROUNDS = 2
"""How often r is recomputed: a contradicted observer also contradicts less."""
CAP = 2.0
"""Largest certainty, in multiples of the participants' mean."""
SURER = 1.2
"""Largest divergence that counts, in multiples of the next surest observer's."""
GAMMA = 0.5
"""With this exponent, four views together are right as often as they claim."""


def robust_weights(p: Floats, prior: Floats, observers: ObserverTrust) -> PoolingWeights:
    """(..., N, M) posteriors, (M,) prior -> how each observer counts; fields (..., N)."""
    ratio = p / prior
    divergence_bits = divergence_from_prior(p, ratio)
    participation = np.minimum(divergence_bits / PARTICIPATION_BITS, 1.0)
    participants = sum_last(participation)
    # How far the rules for two and for three participants apply, 0 to 1.
    two = np.minimum(np.maximum(participants - 1.0, 0.0), 1.0)[..., None]
    three = np.minimum(np.maximum(participants - 2.0, 0.0), 1.0)[..., None]
    eps_one, eps_two, eps_three = ROBUSTNESS
    base_epsilon = eps_one + (eps_two - eps_one) * two + (eps_three - eps_two) * three
    w = _certainty(p, prior, participation, base_epsilon) * observers.trust * _surer_limit(divergence_bits) ** three
    rho = np.maximum(similarity(ratio) * uncertainty(p), observers.correlations) * participation[..., None, :]
    # A single observer has no correlated peer.
    rho *= (participants > 1.0)[..., None, None]
    bayes_factor = _bayes_factor(ratio, prior, w, rho)
    agreement = np.minimum(bayes_factor, 1.0) ** (2.0 * three)
    epsilon = base_epsilon / (base_epsilon + (1.0 - base_epsilon) * bayes_factor**three)
    w = w * agreement / (1.0 + sum_last(rho * agreement[..., None, :]))
    return PoolingWeights(
        exponents=w * np.maximum(sum_last(w * participation), 1.0)[..., None] ** (GAMMA - 1.0),
        epsilon=epsilon,
        shares=shares_of(w * divergence_bits),
    )


def _certainty(p: Floats, prior: Floats, participation: Floats, epsilon: Floats) -> Floats:
    """c of rule 1: (..., N), 0 to CAP."""
    robust = (1.0 - epsilon[..., None]) * p + epsilon[..., None] * prior
    inverse = 1.0 / np.maximum(-sum_last(robust * np.log2(robust)), ENTROPY_FLOOR_BITS)
    weighted = sum_last(participation * inverse)[..., None]
    relative = inverse * sum_last(participation)[..., None] / np.maximum(weighted, SMALLEST)
    return np.where(weighted > 0, np.minimum(relative, CAP), 1.0)


def _surer_limit(divergence_bits: Floats) -> Floats:
    """s of rule 2: (..., N), 0 to 1."""
    if divergence_bits.shape[-1] < 2:
        return np.ones_like(divergence_bits)
    top_two = np.sort(divergence_bits, axis=-1)[..., -2:]
    next_surest = np.where(divergence_bits >= top_two[..., 1:], top_two[..., :1], top_two[..., 1:])
    limit: Floats = np.minimum(SURER * next_surest / np.maximum(divergence_bits, SMALLEST), 1.0)
    return limit


def _bayes_factor(ratio: Floats, prior: Floats, w: Floats, rho: Floats) -> Floats:
    """o of rule 3, after ROUNDS rounds: (..., N)."""
    log_ratio = np.log((1.0 - OTHERS_EPSILON) * ratio + OTHERS_EPSILON)
    log_prior = np.log(prior)
    others = off_diagonal(w.shape[-1])
    agreement, bayes_factor = np.ones_like(w), np.ones_like(w)
    for _ in range(ROUNDS):
        # Row i: the exponents of the others without observer i, which may be correlated with one of them.
        correlated = others @ np.swapaxes(rho * agreement[..., None, :], -1, -2)
        logs = log_prior + (others * (w * agreement)[..., None, :] / (1.0 + correlated)) @ log_ratio
        q = np.exp(logs - np.maximum.reduce(logs, axis=-1)[..., None])
        bayes_factor = sum_last(q * ratio) / sum_last(q)
        agreement = np.minimum(bayes_factor, 1.0) ** 2
    return bayes_factor
