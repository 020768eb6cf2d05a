"""Fusion rules: N observers' posteriors -> one pooled posterior, each rule by its name.

Shapes: p (N, M) posteriors, one row an observer, each row summing to 1; prior (M,), positive; out: weights (N,) and
pooled p (M,). All rules ignore the order of observers, and follow any reordering of labels. To add one: write it,
and put it into RULES; tests/contracts/test_rules.py then holds it to that.

The rules here do it in two steps, so that beliefs over movement and something else (which way the person faces) can be
pooled with the weights that the movements alone have: `weigh` p -> strengths, `mix` of cells (N, M, K) by these.
"""

from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from common.probability import entropy_bits, softmax
from fusion.engine import weights as weigh
from fusion.engine.strengths import ObserverTrust, Strengths, strengths

Floats = NDArray[np.float64]

ROBUSTNESS = 0.05
"""epsilon of (1-eps) p + eps prior in robust_product and median: how often a judge may be plainly wrong."""
SMALLEST = 1e-300
"""Stands for 0 inside a logarithm: one judge's zero stays an all but absolute veto, and two of them no NaN."""


@dataclass(frozen=True, slots=True)
class RuleResult:
    """p (M,) the pooled posterior; weights (N,), summing to 1, as used or, where a rule has none, equal."""

    p: Floats
    weights: Floats


Weigh = Callable[[Floats, Floats, ObserverTrust], Strengths]
"""p (N, M), prior (M,), standing -> strengths."""
Mix = Callable[[Floats, Floats, Strengths], Floats]
"""cells (N, M, K) that sum to 1 for each judge, prior (M,), strengths -> (M, K)."""


@dataclass(frozen=True, slots=True)
class Rule:
    """A named way to pool; `most_observers` is a limit of the method, None for any number.

    weigh, mix: the same in two steps, for beliefs over more than movements; None where it cannot be so taken apart.
    many: whether these take leading axes, so that many scenes are pooled at once.
    """

    name: str
    pool: Callable[[Floats, Floats], RuleResult]
    most_observers: int | None = None
    weigh: Weigh | None = None
    mix: Mix | None = None
    many: bool = False


def in_two_steps(
    name: str, weighing: Weigh, mixing: Mix, most_observers: int | None = None, many: bool = False
) -> Rule:
    """The rule that weighs and then mixes."""

    def pool(p: Floats, prior: Floats) -> RuleResult:
        found = weighing(p, prior, ObserverTrust.unknown(len(p)))
        return RuleResult(mixing(p[:, :, None], prior, found)[:, 0], found.shares)

    return Rule(name, pool, most_observers, weighing, mixing, many)


def by_entropy(weighing: Callable[[Floats], Floats]) -> Weigh:
    """Weights from the entropies alone."""

    def found(p: Floats, prior: Floats, standing: ObserverTrust) -> Strengths:
        weights = weighing(entropy_bits(p))
        return Strengths(weights, np.zeros(len(p)), weights)

    return found


def alike_strong(exponent: Callable[[int], float], epsilon: float = 0.0) -> Weigh:
    """The same `exponent` of the number of judges for everybody."""

    def found(p: Floats, prior: Floats, standing: ObserverTrust) -> Strengths:
        return Strengths(np.full(len(p), exponent(len(p))), np.full(len(p), epsilon), weigh.equal(p[:, 0]))

    return found


def linear_mix(cells: Floats, prior: Floats, found: Strengths) -> Floats:
    """P = sum_i w_i p_i, the weights from the entropies; lies between the smallest and the largest p_i."""
    mixed: Floats = np.tensordot(found.exponents, cells, 1)
    whole: Floats = mixed / mixed.sum()
    return whole


def log_mix(cells: Floats, prior: Floats, found: Strengths) -> Floats:
    """P proportional to prior prod_i (p~_i/prior)^w_i, p~ = (1-eps) p + eps prior.

    - Weights 1/N, eps 0: the log pool, idempotent, and externally Bayesian because the weights sum to 1.
    - Weights 1, eps 0: Bayes' rule for independent observers that share the prior; with eps the same without vetoes.
    - The default's: certainty weighs, and no judge counts more than double, nor with greater odds than eps allows.
    """
    if cells.shape[-1] == 1:
        evidence = _of_movements(cells[..., 0], prior, found.epsilon)
        logs = np.log(prior) + (found.exponents[..., None, :] @ evidence)[..., 0, :]
        return softmax(logs)[..., None]
    evidence = np.tensordot(found.exponents, _evidence(cells, prior, found.epsilon), 1)
    return softmax((np.log(prior)[:, None] + evidence).reshape(-1)).reshape(evidence.shape)


def _of_movements(p: Floats, prior: Floats, epsilon: Floats) -> Floats:
    """(..., N, M) ln(p~/prior)."""
    mixed = (1 - epsilon)[..., None] * (p / prior) + epsilon[..., None]
    return _logs(mixed)


def _evidence(cells: Floats, prior: Floats, epsilon: Floats) -> Floats:
    """(N, M, K) log of p~ over the prior, p~ mixed in the movement and, within each movement, in the rest.

    So what a judge can do to the movement is bounded by eps as it is without K.
    """
    of_movement, size = cells.sum(axis=2), cells.shape[2]
    inside = np.where(of_movement[:, :, None] > 0, cells / np.maximum(of_movement, SMALLEST)[:, :, None], 1.0 / size)
    share = (1 - epsilon)[:, None, None] * inside * size + epsilon[:, None, None]
    whole: Floats = _of_movements(of_movement, prior, epsilon)[:, :, None] + _logs(share)
    return whole


def median_mix(cells: Floats, prior: Floats, found: Strengths) -> Floats:
    """The median over observers of the log odds ln(p/(1-p)) of each movement, normalised."""
    flat = prior[None, :, None] / cells.shape[2]
    epsilon = found.epsilon[:, None, None]
    safe = (1 - epsilon) * cells + epsilon * flat
    log_odds = np.median(np.log(safe) - np.log1p(-safe), axis=0)
    mass = 1.0 / (1.0 + np.exp(-log_odds))
    whole: Floats = mass / mass.sum()
    return whole


def chernoff(p: Floats, prior: Floats, standing: ObserverTrust) -> Strengths:
    """P proportional to p_1^a p_2^(1-a), a in [0, 1] minimising sum p_1^a p_2^(1-a): safe for unknown dependence.

    Hurley, "An information theoretic justification for covariance intersection", FUSION 2002. Two observers.
    The sum is convex in a; golden section finds its minimum to 1e-9.
    """
    if len(p) == 1:
        return Strengths(np.ones(1), np.zeros(1), np.ones(1))
    if len(p) > 2:
        raise BadInput(f"fusion.rule = 'chernoff': for at most two observers, here are {len(p)}; try 'log'")
    logs = _logs(p)

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
    return Strengths(weights, np.zeros(2), weights)


def _logs(p: Floats) -> Floats:
    logs: Floats = np.log(np.maximum(p, SMALLEST))
    return logs


RULES = {
    rule.name: rule
    for rule in (
        in_two_steps("robust_inverse_entropy", strengths, log_mix, many=True),
        in_two_steps("inverse_entropy", by_entropy(weigh.inverse_entropy), linear_mix),
        in_two_steps("iest", by_entropy(weigh.inverse_entropy_static_threshold), linear_mix),
        in_two_steps("ieat", by_entropy(weigh.inverse_entropy_average_threshold), linear_mix),
        in_two_steps("min_entropy", by_entropy(weigh.minimum_entropy), linear_mix),
        in_two_steps("linear", by_entropy(weigh.equal), linear_mix),
        in_two_steps("log", alike_strong(lambda n: 1 / n), log_mix),
        in_two_steps("product", alike_strong(lambda n: 1.0), log_mix),
        in_two_steps("robust_product", alike_strong(lambda n: 1.0, ROBUSTNESS), log_mix),
        in_two_steps("median", alike_strong(lambda n: 1 / n, ROBUSTNESS), median_mix),
        in_two_steps("chernoff", chernoff, log_mix, most_observers=2),
    )
}
DEFAULT_RULE = "robust_inverse_entropy"


def get_rule(name: str, observers: int | None = None) -> Rule:
    """The rule of that name; raises BadInput for an unknown one, or one that cannot hear so many observers."""
    if name not in RULES:
        near = get_close_matches(name, RULES, 1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise BadInput(f"fusion.rule = {name!r}: unknown rule{hint}; known: {', '.join(RULES)}")
    rule = RULES[name]
    if observers is not None and rule.most_observers is not None and observers > rule.most_observers:
        most = rule.most_observers
        raise BadInput(f"fusion.rule = {name!r}: hears at most {most} observers, here are {observers}; try 'log'")
    return rule
