"""Fusion rules: the posteriors of N observers -> one pooled posterior. Each rule has a name in RULES. Pure.

Shapes: p (N, M) posteriors, one row per observer, each summing to 1; prior (M,), positive; result: pooled p (M,) and
weights (N,). No rule depends on the order of observers, and every rule follows a reordering of labels. To add a rule,
write it and put it into RULES; tests/contracts/test_rules.py then checks these properties.

The rules here have two steps, so that joint posteriors over movement and a second variable (which way the person faces)
are pooled with the weights of the movements alone: `weigh` turns p into PoolingWeights, `mix` pools cells (N, M, K) by
them.

Weights by certainty: the paper says "weighted by certainty" and gives no formula (section V.B). Inverse entropy is this
project's reading, after Misra, Bourlard and Tyagi, "New entropy based combination rules in HMM/ANN multi-stream ASR",
ICASSP 2003, which also gives the two thresholds.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from common.errors import BadInput
from common.probability import SMALLEST, Floats, entropy_bits, softmax
from common.text import nearest
from fusion.engine.guarded_pool import MOST_POOLED, guarded_pool
from fusion.engine.guarded_product import guarded_weights
from fusion.engine.robust_inverse_entropy import robust_weights
from fusion.engine.weighing import ENTROPY_FLOOR_BITS, ObserverTrust, PoolingWeights, RuleResult

ROBUSTNESS = 0.05
"""eps of (1-eps) p + eps prior in robust_product and median: the probability that an observer is plainly wrong."""
UNSURE_BITS = 10_000.0
"""The entropy that Misra et al. give to a stream beyond the threshold, so that its weight is nearly 0."""


Weigh = Callable[[Floats, Floats, ObserverTrust], PoolingWeights]
"""p (N, M), prior (M,), trust -> the weights of N observers."""
Mix = Callable[[Floats, Floats, PoolingWeights], Floats]
"""cells (N, M, K), summing to 1 per observer, prior (M,), weights -> (M, K)."""
PoolMovements = Callable[[Floats, Floats, ObserverTrust], RuleResult]
"""p (..., N, M), prior (M,), trust -> the pooled p (..., M) and weights (..., N): both steps at once."""


@dataclass(frozen=True, slots=True)
class Rule:
    """A named way to pool p (N, M) with prior (M,).

    most_observers: limit of the method; None for any number. weigh, mix: the two steps, for posteriors over more than
    movements; None if the rule cannot be split. pool_movements: both steps for movements alone, if there is a quicker
    way; it takes leading axes, and pools many scenes to the same bits as each alone.
    """

    name: str
    pool: Callable[[Floats, Floats], RuleResult]
    most_observers: int | None = None
    weigh: Weigh | None = None
    mix: Mix | None = None
    pool_movements: PoolMovements | None = None


def two_step_rule(
    name: str,
    weigh: Weigh,
    mix: Mix,
    most_observers: int | None = None,
    pool_movements: PoolMovements | None = None,
) -> Rule:
    """The rule that weighs and then mixes."""

    def pool(p: Floats, prior: Floats) -> RuleResult:
        trust = ObserverTrust.unknown(len(p))
        if pool_movements is not None:
            return pool_movements(p, prior, trust)
        weighed = weigh(p, prior, trust)
        return RuleResult(mix(p[:, :, None], prior, weighed)[:, 0], weighed.shares)

    return Rule(name, pool, most_observers, weigh, mix, pool_movements)


# Weights


def inverse_entropy(entropies: Floats) -> Floats:
    """(N,) bits -> (N,) weights w_i = (1/H_i) / sum_j (1/H_j), with H_i not below ENTROPY_FLOOR_BITS."""
    inverse = 1.0 / np.maximum(entropies, ENTROPY_FLOOR_BITS)
    weights: Floats = inverse / inverse.sum()
    return weights


def inverse_entropy_static_threshold(entropies: Floats) -> Floats:
    """IEST: as inverse_entropy, but the weight of an observer with H_i > 1 bit is nearly 0."""
    return inverse_entropy(np.where(entropies > 1.0, UNSURE_BITS, entropies))


def inverse_entropy_average_threshold(entropies: Floats) -> Floats:
    """IEAT: as inverse_entropy, but the weight of an observer less certain than the average is nearly 0."""
    # Equal entropies differ from their own mean by a rounding error, which must not exclude an observer.
    beyond = entropies > entropies.mean() * (1 + 1e-12)
    return inverse_entropy(np.where(beyond, UNSURE_BITS, entropies))


def minimum_entropy(entropies: Floats) -> Floats:
    """The most certain observer counts alone; equally certain ones share."""
    most_certain = entropies <= entropies.min() + 1e-12
    weights: Floats = most_certain / most_certain.sum()
    return weights


def equal_weights(values: Floats) -> Floats:
    """(N,) anything -> (N,) the same weight for every observer."""
    return np.full(len(values), 1.0 / len(values))


def by_entropy(weights_of: Callable[[Floats], Floats]) -> Weigh:
    """Weights from the entropies alone."""

    def weigh(p: Floats, prior: Floats, trust: ObserverTrust) -> PoolingWeights:
        weights = weights_of(entropy_bits(p))
        return PoolingWeights(weights, np.zeros(len(p)), weights)

    return weigh


def same_exponent(exponent: Callable[[int], float], epsilon: float = 0.0) -> Weigh:
    """The same exponent for every observer, a function of their number."""

    def weigh(p: Floats, prior: Floats, trust: ObserverTrust) -> PoolingWeights:
        return PoolingWeights(np.full(len(p), exponent(len(p))), np.full(len(p), epsilon), equal_weights(p[:, 0]))

    return weigh


def chernoff(p: Floats, prior: Floats, trust: ObserverTrust) -> PoolingWeights:
    """P proportional to p_1^a p_2^(1-a), a in [0, 1] minimising sum p_1^a p_2^(1-a): safe for unknown dependence.

    Hurley, "An information theoretic justification for covariance intersection", FUSION 2002. Two observers.
    The sum is convex in a; golden section finds its minimum to 1e-9.
    """
    if len(p) == 1:
        return PoolingWeights(np.ones(1), np.zeros(1), np.ones(1))
    if len(p) > 2:
        raise BadInput(f"fusion.rule = 'chernoff': takes at most 2 observers, here are {len(p)}; try 'log'")
    logs = _safe_log(p)

    def overlap(a: float) -> float:
        return float(np.exp(a * logs[0] + (1 - a) * logs[1]).sum())

    low, high, golden = 0.0, 1.0, (5**0.5 - 1) / 2
    while high - low > 1e-9:
        left, right = high - golden * (high - low), low + golden * (high - low)
        f_left, f_right = overlap(left), overlap(right)
        # Flat (equal observers): shrink from both sides, so that the order of the observers does not matter.
        low, high = (low, right) if f_left < f_right else (left, high) if f_right < f_left else (left, right)
    a = (low + high) / 2
    weights = np.array([a, 1 - a])
    return PoolingWeights(weights, np.zeros(2), weights)


# Mixes


def linear_mix(cells: Floats, prior: Floats, weighed: PoolingWeights) -> Floats:
    """P = sum_i w_i p_i; lies between the smallest and the largest p_i."""
    mixed: Floats = np.tensordot(weighed.exponents, cells, 1)
    pooled: Floats = mixed / mixed.sum()
    return pooled


def log_mix(cells: Floats, prior: Floats, weighed: PoolingWeights) -> Floats:
    """P proportional to prior prod_i (p~_i/prior)^w_i, p~ = (1-eps) p + eps prior.

    - w = 1/N, eps = 0: the log pool, idempotent, and externally Bayesian because the weights sum to 1.
    - w = 1, eps = 0: Bayes' rule for independent observers that share the prior. With eps > 0 the same without vetoes.
    - robust_inverse_entropy: certainty weighs; no observer counts more than twice, nor with greater odds than eps
      allows.
    """
    if cells.shape[-1] == 1:
        log_ratio = _log_ratio(cells[..., 0], prior, weighed.epsilon)
        logs = np.log(prior) + (weighed.exponents[..., None, :] @ log_ratio)[..., 0, :]
        return softmax(logs)[..., None]
    log_ratio = np.tensordot(weighed.exponents, _joint_log_ratio(cells, prior, weighed.epsilon), 1)
    return softmax((np.log(prior)[:, None] + log_ratio).reshape(-1)).reshape(log_ratio.shape)


def averaged_log_mix(cells: Floats, prior: Floats, weighed: PoolingWeights) -> Floats:
    """The average of `log_mix` over the hypotheses of `weighed`, by their probabilities (guarded_product.py)."""
    hypotheses = np.ones(1) if weighed.hypotheses is None else weighed.hypotheses
    if cells.shape[-1] == 1:
        log_ratio = _log_ratio(cells[..., 0], prior, weighed.epsilon)
        pooled = softmax(np.log(prior) + weighed.exponents @ log_ratio)
        return (hypotheses[..., None, :] @ pooled)[..., 0, :, None]
    log_ratio = np.tensordot(weighed.exponents, _joint_log_ratio(cells, prior, weighed.epsilon), 1)
    logs = (np.log(prior)[:, None] + log_ratio).reshape(len(hypotheses), -1)
    return (hypotheses @ softmax(logs)).reshape(log_ratio.shape[1:])


def guarded_product(p: Floats, prior: Floats, trust: ObserverTrust) -> RuleResult:
    """`guarded_pool`; for more than MOST_POOLED observers the plain form, scene by scene.

    The plain form of many scenes together would differ from that of each alone in the last bits.
    """
    if p.shape[-2] <= MOST_POOLED:
        return guarded_pool(p, prior, trust)
    if p.ndim == 3:
        trusts = [ObserverTrust(*scene) for scene in zip(trust.trust, trust.correlations, strict=True)]
        results = [guarded_product(scene, prior, own) for scene, own in zip(p, trusts, strict=True)]
        return RuleResult(np.array([result.p for result in results]), np.array([result.weights for result in results]))
    weighed = guarded_weights(p, prior, trust)
    return RuleResult(averaged_log_mix(p[:, :, None], prior, weighed)[:, 0], weighed.shares)


def _log_ratio(p: Floats, prior: Floats, epsilon: Floats) -> Floats:
    """(..., N, M) ln(p~/prior), the log likelihood up to a constant per observer. epsilon (..., N)."""
    return _safe_log((1 - epsilon)[..., None] * (p / prior) + epsilon[..., None])


def _joint_log_ratio(cells: Floats, prior: Floats, epsilon: Floats) -> Floats:
    """(N, M, K) ln of p~ over the prior.

    eps is mixed into the movements and, within each movement, into the second variable. It therefore bounds the
    influence of one observer on the movement as it does without K.
    """
    p, size = cells.sum(axis=2), cells.shape[2]
    inside = np.where(p[:, :, None] > 0, cells / np.maximum(p, SMALLEST)[:, :, None], 1.0 / size)
    robust = (1 - epsilon)[:, None, None] * inside * size + epsilon[:, None, None]
    log_ratio: Floats = _log_ratio(p, prior, epsilon)[:, :, None] + _safe_log(robust)
    return log_ratio


def median_mix(cells: Floats, prior: Floats, weighed: PoolingWeights) -> Floats:
    """The median over observers of the log odds ln(p/(1-p)) of each movement, normalised."""
    flat = prior[None, :, None] / cells.shape[2]
    epsilon = weighed.epsilon[:, None, None]
    robust = (1 - epsilon) * cells + epsilon * flat
    log_odds = np.median(np.log(robust) - np.log1p(-robust), axis=0)
    mass = 1.0 / (1.0 + np.exp(-log_odds))
    pooled: Floats = mass / mass.sum()
    return pooled


def _safe_log(p: Floats) -> Floats:
    """ln p, finite also for 0."""
    logs: Floats = np.log(np.maximum(p, SMALLEST))
    return logs


RULES = {
    rule.name: rule
    for rule in (
        two_step_rule("guarded_product", guarded_weights, averaged_log_mix, pool_movements=guarded_product),
        two_step_rule("robust_inverse_entropy", robust_weights, log_mix),
        two_step_rule("inverse_entropy", by_entropy(inverse_entropy), linear_mix),
        two_step_rule("iest", by_entropy(inverse_entropy_static_threshold), linear_mix),
        two_step_rule("ieat", by_entropy(inverse_entropy_average_threshold), linear_mix),
        two_step_rule("min_entropy", by_entropy(minimum_entropy), linear_mix),
        two_step_rule("linear", by_entropy(equal_weights), linear_mix),
        two_step_rule("log", same_exponent(lambda n: 1 / n), log_mix),
        two_step_rule("product", same_exponent(lambda n: 1.0), log_mix),
        two_step_rule("robust_product", same_exponent(lambda n: 1.0, ROBUSTNESS), log_mix),
        two_step_rule("median", same_exponent(lambda n: 1 / n, ROBUSTNESS), median_mix),
        two_step_rule("chernoff", chernoff, log_mix, most_observers=2),
    )
}
DEFAULT_RULE = "guarded_product"


def get_rule(name: str, observers: int | None = None) -> Rule:
    """The rule of that name; raises BadInput for an unknown rule, or one that does not take so many observers."""
    if name not in RULES:
        raise BadInput(f"fusion.rule = {name!r}: unknown rule; {nearest(name, RULES)}")
    rule = RULES[name]
    if observers is not None and rule.most_observers is not None and observers > rule.most_observers:
        most = rule.most_observers
        raise BadInput(f"fusion.rule = {name!r}: takes at most {most} observers, here are {observers}; try 'log'")
    return rule
