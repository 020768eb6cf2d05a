"""The default rule: Bayes' product, guarded against one observer that is plainly wrong. Pure.

N observers, M answers. Arrays may have leading axes, written `...`: one scene per entry, each pooled by itself.

Hypothesis 0 says that every observer can be believed, hypothesis i that observer i is plainly wrong: its posterior has
nothing to do with the movement, and is left out. The result is the average over the N + 1 hypotheses,

    P(m) = sum_h P(h) P(m | h),    P(m | h) proportional to prior(m) L_h(m)^(W_h^(gamma-1)),
    L_h(m) = prod_{i not h} (p~_i(m)/prior(m))^w_ih,    p~_i = (1 - eps) p_i + eps prior.

1. P(h) is proportional to odds_h Z_h^BETA with Z_h = sum_m prior(m) L_h(m), so that doubt follows evidence: Z_0/Z_i is
   the Bayes factor of observer i's posterior against a random one, given all others. Observers that agree raise Z_0 by
   far more than the odds, and the result is their product. One that contradicts the others is left out, the more
   surely the surer it and they are. Two that differ can only doubt each other, so doubt needs three that participate.
2. w_ih = t_i / (1 + sum_j rho_ij) over the others j that h believes. t is learned reliability, and rho the correlation:
   near 1 for posteriors that are the same, unless both are certain, or learned from verdicts (reliability.py).
3. W_h = (D0^2 + (sum_i w_ih D_i)^2) / (D0^2 + sum_i w_ih D_i^2), with D the divergence from the prior and D0 =
   PARTICIPATION_BITS: the effective number of observers, N if all say as much, 1 if one says nearly everything. Several
   views of one person are not independent, and with GAMMA they are right as often as they claim. W below 1 counts as 1.
4. eps bounds a veto: with one observer less, the log odds of two answers differ by at most ln(1 + M (1-eps)/eps).

An observer whose posterior is the prior does not participate and changes nothing. All of this changes smoothly with the
number of participants. Averaging over which observation is an outlier: Box and Tiao, "A Bayesian approach to some
outlier problems", Biometrika 55, 1968. The constants were chosen on people left out one at a time.

`guarded_strengths`, mixed by rules.py:averaged_log_mix, is the plain form, for scenes pooled together and for joint
posteriors. `guarded_pool` gives the same for the movements of one scene in half the time.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from common.probability import SMALLEST, Floats
from fusion.engine.strengths import (
    LEAST_SIZE,
    LOG_FLOOR,
    PARTICIPATION_BITS,
    SIMILARITY_SCALE,
    UNCERTAIN_MASS,
    ObserverTrust,
    RuleResult,
    Strengths,
    divergence_from_prior,
    off_diagonal,
    shares_of,
    similarity,
    sum_last,
    uncertainty,
)

Product = Callable[[Floats, Floats], Floats]
"""np.dot of one scene, np.matmul of many: NumPy multiplies each in the same way, and `dot` begins in half the time."""
EPSILON = 0.02
FAULT_PROBABILITY = (0.05, 0.3)
"""Prior probability that an observer is plainly wrong, for three, and for four and more participants.

Two of three agree by mistake more often than three of four.
"""
ODDS_OF_THREE, ODDS_OF_FOUR = (probability / (1.0 - probability) for probability in FAULT_PROBABILITY)
GAMMA = 0.45
BETA = 2.0
"""The evidence for a hypothesis counts twice, because an honest observer is rarely both sure and contradicted."""
EXPONENT_LIMIT = 500.0
"""Far beyond the evidence of some tens of observers; it keeps the exponential finite."""


def guarded_strengths(p: Floats, prior: Floats, observers: ObserverTrust) -> Strengths:
    """(..., N, M) posteriors, (M,) prior -> exponents (..., H, N) and probabilities of H hypotheses: N + 1, or 1."""
    ratio = p / prior
    divergence_bits = divergence_from_prior(p, ratio)
    part = np.minimum(divergence_bits / PARTICIPATION_BITS, 1.0)
    believed = _believed(p.shape[-2])
    # Row j, column i: how much of its voice observer i shares with observer j.
    rho = np.maximum(similarity(ratio) * uncertainty(p), observers.correlations * part[..., :, None])
    w = believed * observers.trust[..., None, :] / (1.0 + believed @ rho)
    hypotheses = _hypotheses(w, ratio, prior, part)
    exponents = w * np.maximum(_effective_number(w, divergence_bits), 1.0)[..., None] ** (GAMMA - 1.0)
    mean_exponents = (hypotheses[..., None, :] @ exponents)[..., 0, :]
    return Strengths(exponents, np.full(p.shape[:-1], EPSILON), shares_of(mean_exponents * divergence_bits), hypotheses)


def guarded_pool(p: Floats, prior: Floats, observers: ObserverTrust) -> RuleResult:
    """(N, M) posteriors, (M,) prior -> the pooled p (M,), and shares (N,); as the plain form to 1e-12.

    Many scenes, (S, N, M), are pooled to the same bits as each alone, on which a replayed capture relies.

    For arrays this small the number of NumPy's calls counts: `dot` is the fastest of them, and of a few numbers plain
    Python is faster. The plain form computes the evidence twice, each pair of observers twice, and normalises each
    hypothesis. Here x_h, ln L_h less its maximum, serves Z_h and P(m | h), and each hypothesis is normalised by its
    factor in the average.
    """
    product = np.dot if p.ndim == 2 else np.matmul
    ratio, believed = p / prior, _believed(p.shape[-2])
    divergence_bits = divergence_from_prior(p, ratio)
    part = np.minimum(divergence_bits / PARTICIPATION_BITS, 1.0)
    rho = _shared_voice(p, ratio, product)
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


def _effective_number(w: Floats, divergence_bits: Floats) -> Floats:
    """W of each hypothesis, (..., H); 1 if no observer participates."""
    evidence = w * divergence_bits[..., None, :]
    squares = (evidence @ divergence_bits[..., None])[..., 0]
    number: Floats = (sum_last(evidence) ** 2 + PARTICIPATION_BITS**2) / (squares + PARTICIPATION_BITS**2)
    return number


def _hypotheses(w: Floats, ratio: Floats, prior: Floats, part: Floats) -> Floats:
    """P(h), (..., H)."""
    number = sum_last(part)
    if w.shape[-2] == 1:
        return np.ones((*number.shape, 1))
    logs = w @ np.log((1.0 - EPSILON) * ratio + EPSILON)
    most = np.maximum.reduce(logs, axis=-1)
    log_z = np.log(np.exp(logs - most[..., None]) @ prior) + most
    odds = ODDS_OF_THREE * np.minimum(np.maximum(number - 2.0, 0.0), 1.0)
    odds = odds + (ODDS_OF_FOUR - ODDS_OF_THREE) * np.minimum(np.maximum(number - 3.0, 0.0), 1.0)
    mass = np.exp(np.minimum(BETA * (log_z - log_z[..., :1]), EXPONENT_LIMIT))
    mass[..., 1:] *= odds[..., None] * part
    hypotheses: Floats = mass / sum_last(mass)[..., None]
    return hypotheses


@cache
def _believed(size: int) -> Floats:
    """(H, N): 1 for an observer that the hypothesis believes. Fewer than three observers leave only hypothesis 0."""
    everybody = np.ones((1, size))
    return everybody if size < 3 else np.concatenate([everybody, off_diagonal(size)])
