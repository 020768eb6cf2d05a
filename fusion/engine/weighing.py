"""What the fusion rules share: their data types, and the divergence and correlation of posteriors. Pure.

N observers, M movements. Arrays may have leading axes, written `...`: one scene per entry, each treated by itself.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from common.probability import Floats

PARTICIPATION_BITS = 0.05
"""An observer participates fully from this divergence from the prior, below it in proportion."""
SIMILARITY_SCALE = 0.05
"""Log distance at which rho of two posteriors falls to 1/e."""
CERTAIN_MASS = 0.03
"""Two observers are certain if their mean posterior leaves less than this to all labels but one."""
LOG_FLOOR = 0.01
"""Share of the prior that is mixed into posteriors before their logs are compared, so that zeros stay finite."""
LEAST_LOG_SIZE = 1e-9
"""Nats; a posterior whose log ratios to the prior add up to less carries no information."""
ENTROPY_FLOOR_BITS = 0.01
"""A one-hot posterior has entropy 0 and would weigh infinitely; no observer counts as surer than this."""
NATS_TO_BITS = 1.0 / math.log(2.0)


@dataclass(slots=True)
class ObserverTrust:
    """How far a rule relies on N observers: trust (..., N), and symmetric correlations (..., N, N); all 0 to 1.

    trust: in the labels and the course of each observer (trust.py).
    """

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
        """The observers at these places, in order, of one scene."""
        if len(places) == len(self.trust):
            return self
        if not (self.has_correlations or self.has_trust):
            return ObserverTrust.unknown(len(places))
        return ObserverTrust(self.trust[list(places)], self.correlations[np.ix_(places, places)])


@dataclass(slots=True)
class RuleResult:
    """The pooled p (M,), or (R, K) of a joint posterior; weights (N,), summing to 1, equal if a rule has none.

    Nothing changes one; it is not frozen, because that takes four times as long to make, and each step makes some.
    """

    p: Floats
    weights: Floats


@dataclass(frozen=True, slots=True)
class PoolingWeights:
    """How each observer counts, all (..., N).

    exponents: w, of its likelihood ratio p~/prior; (..., H, N) in a rule that averages over H hypotheses, whose
    probabilities are `hypotheses` (..., H). epsilon: share of the prior in p~ = (1 - epsilon) p + epsilon prior.
    shares: its part in the result, summing to 1.
    """

    exponents: Floats
    epsilon: Floats
    shares: Floats
    hypotheses: Floats | None = None


Weigh = Callable[[Floats, Floats, ObserverTrust], PoolingWeights]
"""p (N, M), prior (M,), trust -> the weights of N observers."""
Mix = Callable[[Floats, Floats, PoolingWeights], Floats]
"""cells (N, M, K), summing to 1 per observer, prior (M,), weights -> (M, K)."""
PoolMovements = Callable[[Floats, Floats, ObserverTrust], RuleResult]
"""p (..., N, M), prior (M,), trust -> the pooled p (..., M) and weights (..., N): both steps at once."""


@dataclass(frozen=True, slots=True)
class Rule:
    """A named way to pool p (N, M) with prior (M,).

    pool_movements: both steps for movements alone, if there is a quicker way; it takes leading axes, and pools many
    scenes to the same bits as each alone.
    """

    name: str
    weigh: Weigh
    mix: Mix
    pool_movements: PoolMovements | None = None

    def pool(self, p: Floats, prior: Floats, trust: ObserverTrust | None = None) -> RuleResult:
        """The pooled posterior and the weights; p has leading axes only if there is `pool_movements`."""
        trust = trust or ObserverTrust.unknown(p.shape[-2])
        if self.pool_movements is not None:
            return self.pool_movements(p, prior, trust)
        weighed = self.weigh(p, prior, trust)
        return RuleResult(self.mix(p[:, :, None], prior, weighed)[:, 0], weighed.shares)


def uncertainty(p: Floats) -> Floats:
    """(..., N, M) posteriors -> (..., N, N), 0 to 1: 0 for two that are certain of the same label, 1 for others.

    It multiplies `similarity`: to be certain of the same label shows no correlation.
    """
    top = np.maximum.reduce(p[..., :, None, :] + p[..., None, :, :], axis=-1)
    result: Floats = np.minimum((1.0 - top / 2) / CERTAIN_MASS, 1.0)
    return result


def similarity(ratio: Floats) -> Floats:
    """(..., N, M) ratios p/prior -> (..., N, N): 1 for equal posteriors, near 0 for independent ones; diagonal 0."""
    result: Floats = np.exp(log_distance(ratio) / -SIMILARITY_SCALE) * off_diagonal(ratio.shape[-2])
    return result


def log_distance(ratio: Floats) -> Floats:
    """(..., N, M) ratios p/prior -> (..., N, N) L1 distance of their logs, over the mean L1 size of both.

    0 for equal posteriors, 1 for two that are both the prior.
    """
    logs = np.log((1.0 - LOG_FLOOR) * ratio + LOG_FLOOR)
    sizes = sum_last(np.abs(logs))
    mean_size = (sizes[..., :, None] + sizes[..., None, :]) / 2
    difference = logs[..., :, None, :] - logs[..., None, :, :]
    distance = sum_last(np.abs(difference, out=difference))
    # Two observers at the prior are not correlated.
    return np.where(mean_size > LEAST_LOG_SIZE, distance / np.maximum(mean_size, LEAST_LOG_SIZE), 1.0)


@cache
def off_diagonal(size: int) -> Floats:
    """(N, N): 0 on the diagonal, 1 elsewhere."""
    return 1.0 - np.eye(size)


def sum_last(values: Floats) -> Floats:
    """The sum along the last axis, in half the time of `sum`."""
    total: Floats = np.add.reduce(values, axis=-1)
    return total
