"""Fusion rules: N observers' posteriors -> one pooled posterior, each rule by its name.

Shapes: p (N, M) posteriors, one row an observer, each row summing to 1; prior (M,), positive; out: weights (N,) and
pooled p (M,). All rules ignore the order of observers, and follow any reordering of labels. To add one: write it,
and put it into RULES; tests/contracts/test_rules.py then holds it to that.
"""

from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from common.probability import entropy_bits, from_logs, normalise
from fusion import weights as weigh

Floats = NDArray[np.float64]

ROBUSTNESS = 0.05
"""epsilon of (1-eps) p + eps prior: how often a judge may be plainly wrong; bounds what one judge can do."""
SMALLEST = 1e-300
"""Stands for 0 inside a logarithm: one judge's zero stays an all but absolute veto, and two of them no NaN."""


@dataclass(frozen=True, slots=True)
class Pooled:
    """p (M,) the pooled posterior; weights (N,), summing to 1, as used or, where a rule has none, equal."""

    p: Floats
    weights: Floats


Weighing = Callable[[Floats], Floats]


@dataclass(frozen=True, slots=True)
class Rule:
    """A named way to pool; `most_observers` is a limit of the method, None for any number."""

    name: str
    pool: Callable[[Floats, Floats], Pooled]
    most_observers: int | None = None


def linear_pool(weighing: Weighing) -> Callable[[Floats, Floats], Pooled]:
    """P = sum_i w_i p_i, the weights from the entropies; lies between the smallest and the largest p_i."""

    def pool(p: Floats, prior: Floats) -> Pooled:
        weights = weighing(entropy_bits(p))
        return Pooled(normalise(weights @ p), weights)

    return pool


def log_pool(p: Floats, prior: Floats) -> Pooled:
    """P proportional to prod_i p_i^(1/N): idempotent, and externally Bayesian because the weights sum to 1."""
    weights = weigh.equal(p[:, 0])
    return Pooled(from_logs(weights @ _logs(p)), weights)


def product(p: Floats, prior: Floats) -> Pooled:
    """P proportional to prior prod_i p_i/prior: Bayes' rule for independent observers that share the prior."""
    return Pooled(from_logs(np.log(prior) + (_logs(p) - np.log(prior)).sum(axis=0)), weigh.equal(p[:, 0]))


def robust_product(p: Floats, prior: Floats) -> Pooled:
    """The product of (1-eps) p_i + eps prior: one judge's log odds are at most ln((1-eps+eps/M)/(eps/M))."""
    return product(_robust(p, prior), prior)


def median(p: Floats, prior: Floats) -> Pooled:
    """The median over observers of the log odds ln(p/(1-p)) of each movement, normalised."""
    safe = _robust(p, prior)
    log_odds = np.median(np.log(safe) - np.log1p(-safe), axis=0)
    return Pooled(normalise(1.0 / (1.0 + np.exp(-log_odds))), weigh.equal(p[:, 0]))


def chernoff(p: Floats, prior: Floats) -> Pooled:
    """P proportional to p_1^a p_2^(1-a), a in [0, 1] minimising sum p_1^a p_2^(1-a): safe for unknown dependence.

    Hurley, "An information theoretic justification for covariance intersection", FUSION 2002. Two observers.
    The sum is convex in a; golden section finds its minimum to 1e-9.
    """
    if len(p) == 1:
        return Pooled(p[0].copy(), np.ones(1))
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
    return Pooled(from_logs(weights @ logs), weights)


def robust_inverse_entropy(p: Floats, prior: Floats) -> Pooled:
    """ln P = ln prior + sum_i N w_i ln(p~_i/prior), p~ = (1-eps) p + eps prior, w inverse entropy, capped at 2/N.

    The default: keeps the idea that certainty weighs, and bounds what a judge can do who is sure and wrong: no
    judge counts more than double, nor with greater odds than eps allows.
    """
    safe = _robust(p, prior)
    weights = weigh.capped(weigh.inverse_entropy(entropy_bits(safe)), 2.0 / len(p))
    log_ratio = np.log(safe) - np.log(prior)
    return Pooled(from_logs(np.log(prior) + len(p) * weights @ log_ratio), weights)


def _robust(p: Floats, prior: Floats) -> Floats:
    return (1 - ROBUSTNESS) * p + ROBUSTNESS * prior


def _logs(p: Floats) -> Floats:
    logs: Floats = np.log(np.maximum(p, SMALLEST))
    return logs


RULES = {
    rule.name: rule
    for rule in (
        Rule("robust_inverse_entropy", robust_inverse_entropy),
        Rule("inverse_entropy", linear_pool(weigh.inverse_entropy)),
        Rule("iest", linear_pool(weigh.inverse_entropy_static_threshold)),
        Rule("ieat", linear_pool(weigh.inverse_entropy_average_threshold)),
        Rule("min_entropy", linear_pool(weigh.minimum_entropy)),
        Rule("linear", linear_pool(weigh.equal)),
        Rule("log", log_pool),
        Rule("product", product),
        Rule("robust_product", robust_product),
        Rule("median", median),
        Rule("chernoff", chernoff, most_observers=2),
    )
}
DEFAULT_RULE = "robust_inverse_entropy"


def rule_named(name: str, observers: int | None = None) -> Rule:
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
