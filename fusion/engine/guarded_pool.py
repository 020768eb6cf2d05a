"""The default rule for movements alone, in half the time of its plain form. Pure.

The formulas stand in guarded_product.py. The result is that of `guarded_strengths` and `averaged_log_mix` to 1e-12;
tests compare them. Many scenes are pooled to the same bits as each alone, on which a replayed capture relies. With
arrays as small as 4 by 20 the number of NumPy's calls counts:

- x_h(m) = ln L_h(m) less its maximum over m serves both Z_h and P(m | h), and cannot overflow.
- Each hypothesis is normalised by its factor in the average, not by itself.
- Each pair of observers is compared once, by products with matrices of 0 and 1.
- The probabilities of a few hypotheses are computed in plain Python.

Dimensions: S scenes, N observers, M answers, H hypotheses, P pairs of observers; `...` is S or nothing.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from common.probability import SMALLEST, Floats
from fusion.engine.guarded_product import (
    BETA,
    EPSILON,
    EXPONENT_LIMIT,
    GAMMA,
    ODDS_OF_FOUR,
    ODDS_OF_THREE,
    believed_by,
)
from fusion.engine.strengths import (
    LEAST_SIZE,
    LOG_FLOOR,
    PARTICIPATION_BITS,
    SIMILARITY_SCALE,
    UNCERTAIN_MASS,
    ObserverTrust,
    RuleResult,
    divergence_from_prior,
    off_diagonal,
    similarity,
    uncertainty,
)

Product = Callable[[Floats, Floats], Floats]
"""np.dot of one scene, np.matmul of many: NumPy multiplies each in the same way, and `dot` begins in half the time."""
MOST_PAIRED = 16
"""The matrices of more observers' pairs would be large."""


def guarded_pool(p: Floats, prior: Floats, observers: ObserverTrust) -> RuleResult:
    """(..., N, M) posteriors, (M,) prior -> the pooled p (..., M), and shares (..., N)."""
    product = np.dot if p.ndim == 2 else np.matmul
    ratio, believed = p / prior, believed_by(p.shape[-2])
    divergence_bits = divergence_from_prior(p, ratio)
    part = np.minimum(divergence_bits / PARTICIPATION_BITS, 1.0)
    rho = _shared_voice(p, ratio, product) if p.shape[-2] <= MOST_PAIRED else similarity(ratio) * uncertainty(p)
    if observers.has_correlations:
        rho = np.maximum(rho, observers.correlations * part[..., None])
    w = believed * observers.trust[..., None, :] / (1.0 + product(believed, rho))
    log_likelihood = product(w, np.log((1.0 - EPSILON) * ratio + EPSILON))
    most = np.maximum.reduce(log_likelihood, axis=-1)
    x = log_likelihood - most[..., None]
    hypotheses = _hypothesis_probabilities(part, np.log(product(np.exp(x), prior)) + most)
    squares = _of_each(product, w, divergence_bits**2)
    number = (_of_each(product, w, divergence_bits) ** 2 + PARTICIPATION_BITS**2) / (squares + PARTICIPATION_BITS**2)
    factor = np.maximum(number, 1.0) ** (GAMMA - 1.0)
    mass = np.exp(factor[..., None] * x)
    pooled = _average(product, hypotheses / product(mass, prior), mass) * prior
    evidence = _average(product, hypotheses * factor, w) * divergence_bits + SMALLEST
    return RuleResult(pooled, evidence / np.add.reduce(evidence, axis=-1, keepdims=True))


def _of_each(product: Product, matrices: Floats, vectors: Floats) -> Floats:
    """(..., H, N) times (..., N) -> (..., H)."""
    return product(matrices, vectors) if vectors.ndim == 1 else product(matrices, vectors[..., None])[..., 0]


def _average(product: Product, weights: Floats, rows: Floats) -> Floats:
    """(..., H) times (..., H, M) -> (..., M)."""
    return product(weights, rows) if weights.ndim == 1 else product(weights[..., None, :], rows)[..., 0, :]


def _shared_voice(p: Floats, ratio: Floats, product: Product) -> Floats:
    """(..., N, N) rho of posteriors that are the same, unless both are certain: `similarity` times `uncertainty`."""
    size, movements = p.shape[-2:]
    if size == 1:
        return np.zeros((1, 1))
    pairs, each = _pairs(size), _ones(movements)
    # One call for the sizes of N logs, and the distances of P pairs.
    logs = np.log((1.0 - LOG_FLOOR) * ratio + LOG_FLOOR)
    sums = product(np.abs(product(pairs.singles_and_differences, logs)), each)
    sizes, distance = _of_each(product, pairs.sums, sums[..., :size]), sums[..., size:]
    # Over the sum of both sizes; of two observers that know nothing the distance is 1, over their mean.
    if np.minimum.reduce(sizes, axis=None) > 2 * LEAST_SIZE:
        relative = distance / sizes
    else:
        relative = np.where(sizes > 2 * LEAST_SIZE, distance / np.maximum(sizes, 2 * LEAST_SIZE), 0.5)
    top = np.maximum.reduce(product(pairs.sums, p), axis=-1)
    rho = np.exp(relative * (-2.0 / SIMILARITY_SCALE)) * np.minimum((2.0 - top) / (2.0 * UNCERTAIN_MASS), 1.0)
    result: Floats = rho.take(pairs.place, axis=-1) * off_diagonal(size)
    return result


def _hypothesis_probabilities(part: Floats, log_z: Floats) -> Floats:
    """P(h), (..., H)."""
    if part.ndim == 1:
        return np.array(_posterior_odds(part.tolist(), log_z.tolist()))
    scenes = zip(part.tolist(), log_z.tolist(), strict=True)
    return np.array([_posterior_odds(*scene) for scene in scenes])


def _posterior_odds(part: list[float], log_z: list[float]) -> list[float]:
    """P(h) of the H hypotheses (1), from how far each observer participates."""
    if len(log_z) == 1:
        return [1.0]
    number = sum(part)
    odds = ODDS_OF_THREE * min(max(number - 2.0, 0.0), 1.0)
    odds += (ODDS_OF_FOUR - ODDS_OF_THREE) * min(max(number - 3.0, 0.0), 1.0)
    everybody, *one_wrong = log_z
    doubt = [
        odds * share * math.exp(min(BETA * (z - everybody), EXPONENT_LIMIT))
        for share, z in zip(part, one_wrong, strict=True)
    ]
    total = 1.0 + sum(doubt)
    return [1.0 / total, *(each / total for each in doubt)]


@dataclass(frozen=True, slots=True)
class _Pairs:
    """The P pairs of N observers, as matrices: (P, N) with the sum of each pair, (N + P, N) with each observer and then
    the difference of each pair; place (N, N): the pair of two observers, any of one with itself."""

    sums: Floats
    singles_and_differences: Floats
    place: NDArray[np.intp]


@cache
def _pairs(size: int) -> _Pairs:
    first, second = np.triu_indices(size, 1)
    number = np.arange(len(first))
    differences, place = np.zeros((len(first), size)), np.zeros((size, size), dtype=np.intp)
    differences[number, first], differences[number, second] = 1.0, -1.0
    place[first, second] = place[second, first] = number
    return _Pairs(np.abs(differences), np.concatenate((np.eye(size), differences)), place)


@cache
def _ones(size: int) -> Floats:
    return np.ones(size)
