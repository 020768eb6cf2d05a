"""How strongly the rule `robust_inverse_entropy` weighs each observer's evidence. Pure.

N observers, M movements. Arrays may have leading axes, written `...`: one scene per entry, each weighed by itself.

Observer i adds w_i ln(p~_i/prior) to the pooled log posterior, with p~_i = (1 - eps_i) p_i + eps_i prior and
w_i = c_i s_i r_i t_i / d_i . W^(gamma-1):

1. c: certainty. The inverse entropy of p~_i, divided by its mean over the participating observers, at most CAP.
2. s: limit on being surer than the others. The divergence of p_i from the prior, in bits, counts up to SURER times
   that of the next surest observer, because all of them see the same movement at the same time.
3. r = min(1, o)^2: agreement with the others. o = sum_m q(m) p_i(m)/prior(m), where q is the others' pooled
   posterior, is the Bayes factor of p_i against a random one. It lowers a contradicted observer and raises none.
4. eps: the probability that the observer is plainly wrong, updated by o: eps_i = eps / (eps + (1-eps) o).
5. t: learned reliability (reliability.py), at most 1.
6. d = 1 + sum_j rho_ij: correlated observers share one voice. rho comes from similar posteriors, unless both are
   certain, or from earlier verdicts (reliability.py).
7. W = sum_i w_i before this factor, if above 1: several views of one person are not independent.

Rules 2 to 4 need three participating observers, because two can only doubt each other; eps grows with their number for
the same reason. An observer whose posterior is the prior does not participate. All of this changes smoothly with the
number of participants. The constants were chosen by hand, on posteriors learned without the person they are about.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from common.probability import SMALLEST, Floats

PARTICIPATION_BITS = 0.05
"""An observer participates fully from this divergence from the prior, below it in proportion."""
ROBUSTNESS = (0.01, 0.05, 0.2)
"""eps for one, two, and three or more participants, linear in between."""
OTHERS_EPSILON = 0.2
"""eps of the others in rule 3."""
ROUNDS = 2
"""How often r is recomputed: a contradicted observer also contradicts less."""
CAP = 2.0
SURER = 1.2
GAMMA = 0.5
"""With this, four views together are right as often as they claim."""
SIMILARITY_SCALE = 0.05
"""Log distance at which rho of two posteriors falls to 1/e."""
UNCERTAIN_MASS = 0.03
"""Two observers are certain if their mean posterior leaves less than this to all labels but one."""
LOG_FLOOR = 0.01
LEAST_SIZE = 1e-9
"""An observer whose logs are smaller together knows nothing."""
NATS_TO_BITS = 1.0 / math.log(2.0)
ENTROPY_FLOOR_BITS = 0.01
"""A one-hot posterior has entropy 0 and would weigh infinitely; no observer counts as surer than this."""


@dataclass(slots=True)
class ObserverTrust:
    """Learned from verdicts about N observers: trust (..., N), and symmetric correlations (..., N, N); all 0 to 1."""

    trust: Floats
    correlations: Floats
    has_correlations: bool = True
    """False: all are 0."""
    has_trust: bool = True
    """False: all is 1."""

    @staticmethod
    @cache
    def unknown(size: int) -> "ObserverTrust":
        """Full trust and no correlation, for `size` observers."""
        return ObserverTrust(np.ones(size), np.zeros((size, size)), has_correlations=False, has_trust=False)

    @staticmethod
    def stack(scenes: Sequence["ObserverTrust"]) -> "ObserverTrust":
        """Several scenes with as many observers each, along a new first axis."""
        trust, correlations = np.array([s.trust for s in scenes]), np.array([s.correlations for s in scenes])
        return ObserverTrust(
            trust, correlations, any(s.has_correlations for s in scenes), any(s.has_trust for s in scenes)
        )

    def subset(self, places: Sequence[int]) -> "ObserverTrust":
        """The observers at these places, of one scene."""
        return ObserverTrust(self.trust[list(places)], self.correlations[np.ix_(places, places)])


@dataclass(slots=True)
class RuleResult:
    """The pooled p (M,), or (R, K) of a joint posterior; weights (N,), summing to 1, equal if a rule has none.

    Nothing changes one; it is not frozen, because that takes four times as long to make, and each step makes some.
    """

    p: Floats
    weights: Floats


@dataclass(frozen=True, slots=True)
class Strengths:
    """How each observer counts, all (..., N).

    exponents: w, of its evidence; (..., H, N) in a rule that averages over H hypotheses, whose probabilities are
    `hypotheses` (..., H). epsilon: the prior's part in p~. shares: its part in the result, summing to 1.
    """

    exponents: Floats
    epsilon: Floats
    shares: Floats
    hypotheses: Floats | None = None


def strengths(p: Floats, prior: Floats, observers: ObserverTrust) -> Strengths:
    """(..., N, M) posteriors, (M,) prior -> how each observer counts in `robust_inverse_entropy`."""
    ratio = p / prior
    divergence_bits = divergence_from_prior(p, ratio)
    part = np.minimum(divergence_bits / PARTICIPATION_BITS, 1.0)
    number = sum_last(part)
    # How far the rules for two and for three participants apply, 0 to 1.
    two = np.minimum(np.maximum(number - 1.0, 0.0), 1.0)[..., None]
    three = np.minimum(np.maximum(number - 2.0, 0.0), 1.0)[..., None]
    eps_one, eps_two, eps_three = ROBUSTNESS
    base_epsilon = eps_one + (eps_two - eps_one) * two + (eps_three - eps_two) * three
    w = _certainty(p, prior, part, base_epsilon) * observers.trust * _surer_limit(divergence_bits) ** three
    rho = np.maximum(similarity(ratio) * uncertainty(p), observers.correlations) * part[..., None, :]
    # A single observer has no correlated peer.
    rho *= (number > 1.0)[..., None, None]
    bayes_factor = _bayes_factor(ratio, prior, w, rho)
    agreement = np.minimum(bayes_factor, 1.0) ** (2.0 * three)
    epsilon = base_epsilon / (base_epsilon + (1.0 - base_epsilon) * bayes_factor**three)
    w = w * agreement / (1.0 + sum_last(rho * agreement[..., None, :]))
    return Strengths(
        exponents=w * np.maximum(sum_last(w * part), 1.0)[..., None] ** (GAMMA - 1.0),
        epsilon=epsilon,
        shares=shares_of(w * divergence_bits),
    )


def divergence_from_prior(p: Floats, ratio: Floats) -> Floats:
    """(..., N, M) posteriors, and the same over the prior -> (..., N) bits, not below 0."""
    # As guarded_pool.py computes it, to the last bit: shares of almost nothing depend on it.
    bits: Floats = np.maximum(p * np.log(ratio + SMALLEST) @ np.full(p.shape[-1], NATS_TO_BITS), 0.0)
    return bits


def shares_of(evidence: Floats) -> Floats:
    """(..., N) -> parts of the sum along the last axis; equal parts of nothing."""
    total = sum_last(evidence)[..., None]
    return np.where(total > 0, evidence / np.maximum(total, SMALLEST), 1.0 / evidence.shape[-1])


def _certainty(p: Floats, prior: Floats, part: Floats, epsilon: Floats) -> Floats:
    """c of rule 1."""
    robust = (1.0 - epsilon[..., None]) * p + epsilon[..., None] * prior
    inverse = 1.0 / np.maximum(-sum_last(robust * np.log2(robust)), ENTROPY_FLOOR_BITS)
    weighted = sum_last(part * inverse)[..., None]
    relative = inverse * sum_last(part)[..., None] / np.maximum(weighted, SMALLEST)
    return np.where(weighted > 0, np.minimum(relative, CAP), 1.0)


def _surer_limit(divergence_bits: Floats) -> Floats:
    """s of rule 2."""
    if divergence_bits.shape[-1] < 2:
        return np.ones_like(divergence_bits)
    top_two = np.sort(divergence_bits, axis=-1)[..., -2:]
    next_surest = np.where(divergence_bits >= top_two[..., 1:], top_two[..., :1], top_two[..., 1:])
    limit: Floats = np.minimum(SURER * next_surest / np.maximum(divergence_bits, SMALLEST), 1.0)
    return limit


def _bayes_factor(ratio: Floats, prior: Floats, w: Floats, rho: Floats) -> Floats:
    """o of rule 3, after ROUNDS rounds: (..., N)."""
    evidence = np.log((1.0 - OTHERS_EPSILON) * ratio + OTHERS_EPSILON)
    log_prior = np.log(prior)
    others = off_diagonal(w.shape[-1])
    agreement, bayes_factor = np.ones_like(w), np.ones_like(w)
    for _ in range(ROUNDS):
        # Row i: how much each of the others counts without observer i, which may be correlated with one of them.
        correlated = others @ np.swapaxes(rho * agreement[..., None, :], -1, -2)
        logs = log_prior + (others * (w * agreement)[..., None, :] / (1.0 + correlated)) @ evidence
        q = np.exp(logs - np.maximum.reduce(logs, axis=-1)[..., None])
        bayes_factor = sum_last(q * ratio) / sum_last(q)
        agreement = np.minimum(bayes_factor, 1.0) ** 2
    return bayes_factor


def uncertainty(p: Floats) -> Floats:
    """(..., N, N): falls from 1 to 0 for two that are certain of the same, because that does not show correlation."""
    top = np.maximum.reduce(p[..., :, None, :] + p[..., None, :, :], axis=-1)
    result: Floats = np.minimum((1.0 - top / 2) / UNCERTAIN_MASS, 1.0)
    return result


def similarity(ratio: Floats) -> Floats:
    """(..., N, M) posteriors over the prior -> (..., N, N): 1 for equal ones, near 0 for independent ones."""
    result: Floats = np.exp(log_distance(ratio) / -SIMILARITY_SCALE) * off_diagonal(ratio.shape[-2])
    return result


def log_distance(ratio: Floats) -> Floats:
    """(..., N, M) posteriors over the prior -> (..., N, N) mean distance of their logs, over the logs' mean size.

    0 for equal posteriors, 1 for two that are both the prior.
    """
    logs = np.log((1.0 - LOG_FLOOR) * ratio + LOG_FLOOR)
    sizes = sum_last(np.abs(logs))
    mean_size = (sizes[..., :, None] + sizes[..., None, :]) / 2
    difference = logs[..., :, None, :] - logs[..., None, :, :]
    distance = sum_last(np.abs(difference, out=difference))
    # Two observers that know nothing are not correlated.
    return np.where(mean_size > LEAST_SIZE, distance / np.maximum(mean_size, LEAST_SIZE), 1.0)


@cache
def off_diagonal(size: int) -> Floats:
    """(N, N): 0 on the diagonal, 1 elsewhere."""
    return 1.0 - np.eye(size)


def sum_last(values: Floats) -> Floats:
    """The sum along the last axis, in half the time of `sum`."""
    total: Floats = np.add.reduce(values, axis=-1)
    return total
