"""What fusion rules are made of: weights of observers, and mixes of their posteriors. Pure.

Shapes: p (N, M) posteriors, one row per observer, each summing to 1; prior (M,), positive; cells (N, M, K) posteriors
over the movements and a second variable of K values. Sources of the weights: fusion.md, "Weights".
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from common.probability import SMALLEST, Floats, entropy_bits, softmax

ENTROPY_FLOOR_BITS = 0.01
"""A one-hot posterior has entropy 0 and would weigh infinitely; no observer counts as surer than this."""
Trust = Floats | None
"""(N,) above 0 to 1, how far each observer is relied on (trust.py); None: all are, fully."""


@dataclass(slots=True)
class RuleResult:
    """The pooled p (M,), or (R, K) of a joint posterior; weights (N,), summing to 1, equal if a rule has none.

    Of a rule that averages over hypotheses, none and then each observer being wrong: their probabilities (H,), and the
    likelihood of each answer under each but for a factor, `likelihoods` (H, M). Not frozen: to make one takes four
    times as long.
    """

    p: Floats
    weights: Floats
    hypotheses: Floats | None = None
    likelihoods: Floats | None = None


@dataclass(frozen=True, slots=True)
class PoolingWeights:
    """How each of N observers counts.

    exponents: w (N,), of its likelihood ratio p~/prior; (H, N) in a rule that averages over H hypotheses, whose
    probabilities are `hypotheses` (H,). epsilon (N,): share of the prior in p~ = (1 - epsilon) p + epsilon prior.
    shares (N,): its part in the result, summing to 1.
    """

    exponents: Floats
    epsilon: Floats
    shares: Floats
    hypotheses: Floats | None = None


Weigh = Callable[[Floats, Floats, Trust], PoolingWeights]
"""p (N, M), prior (M,), trust -> the weights of N observers."""
Mix = Callable[[Floats, Floats, PoolingWeights], Floats]
"""cells (N, M, K), summing to 1 per observer, prior (M,), weights -> (M, K)."""
PoolMovements = Callable[..., RuleResult]
"""p (..., N, M), prior (M,), trust (..., N), None by default -> p (..., M), weights (..., N): both steps at once."""


@dataclass(frozen=True)
class Rule:
    """A named way to pool p (N, M) with prior (M,).

    pool_movements: both steps for movements alone, if there is a quicker way; it takes leading axes, and pools many
    scenes to the same bits as each alone. pool: the same, or else one step after the other, without leading axes.
    """

    name: str
    weigh: Weigh
    mix: Mix
    pool_movements: PoolMovements | None = None
    pool: PoolMovements = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "pool", self.pool_movements or self._weigh_and_mix)

    def _weigh_and_mix(self, p: Floats, prior: Floats, trust: Trust = None, /) -> RuleResult:
        weighed = self.weigh(p, prior, trust)
        return RuleResult(self.mix(p[:, :, None], prior, weighed)[:, 0], weighed.shares)


def inverse_entropy(entropies: Floats) -> Floats:
    """(N,) bits -> (N,) weights w_i = (1/H_i) / sum_j (1/H_j), with H_i not below ENTROPY_FLOOR_BITS."""
    inverse = 1.0 / np.maximum(entropies, ENTROPY_FLOOR_BITS)
    weights: Floats = inverse / inverse.sum()
    return weights


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

    def weigh(p: Floats, prior: Floats, trust: Trust) -> PoolingWeights:
        weights = weights_of(entropy_bits(p))
        return PoolingWeights(weights, np.zeros(len(p)), weights)

    return weigh


def same_exponent(exponent: Callable[[int], float]) -> Weigh:
    """The same exponent for every observer, a function of their number."""

    def weigh(p: Floats, prior: Floats, trust: Trust) -> PoolingWeights:
        return PoolingWeights(np.full(len(p), exponent(len(p))), np.zeros(len(p)), equal_weights(p[:, 0]))

    return weigh


def linear_mix(cells: Floats, prior: Floats, weighed: PoolingWeights) -> Floats:
    """P = sum_i w_i p_i; lies between the smallest and the largest p_i."""
    mixed: Floats = np.tensordot(weighed.exponents, cells, 1)
    pooled: Floats = mixed / mixed.sum()
    return pooled


def log_mix(cells: Floats, prior: Floats, weighed: PoolingWeights) -> Floats:
    """P proportional to prior prod_i (p~_i/prior)^w_i, p~ = (1-eps) p + eps prior; its average over hypotheses, if any.

    - w = 1/N, eps = 0: the log pool, idempotent, and externally Bayesian because the weights sum to 1.
    - w = 1, eps = 0: Bayes' rule for independent observers that share the prior.
    """
    hypotheses = np.ones(1) if weighed.hypotheses is None else weighed.hypotheses
    exponents = np.atleast_2d(weighed.exponents)
    log_ratio = np.tensordot(exponents, _joint_log_ratio(cells, prior, weighed.epsilon), 1)
    logs = (np.log(prior)[:, None] + log_ratio).reshape(len(hypotheses), -1)
    return (hypotheses @ softmax(logs)).reshape(log_ratio.shape[1:])


def _joint_log_ratio(cells: Floats, prior: Floats, epsilon: Floats) -> Floats:
    """(N, M, K) ln of p~ over the prior.

    eps is mixed into the movements and, within each movement, into the second variable. It therefore bounds the
    influence of one observer on the movement as it does without K.
    """
    p, epsilon, size = cells.sum(axis=2, keepdims=True), epsilon[:, None, None], cells.shape[2]
    inside = np.where(p > SMALLEST, cells / np.maximum(p, SMALLEST), 1.0 / size)
    movement = np.maximum((1 - epsilon) * (p / prior[:, None]) + epsilon, SMALLEST)
    second = np.maximum((1 - epsilon) * inside * size + epsilon, SMALLEST)
    log_ratio: Floats = np.log(movement) + np.log(second)
    return log_ratio
