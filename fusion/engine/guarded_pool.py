"""The default rule for movements alone, in a third of the time of its plain form. Pure.

The formulas stand in guarded_product.py. The result is that of `guarded_weights` and `averaged_log_mix` to 1e-12;
tests compare them. Many scenes are pooled to the same bits as each alone, on which a replayed capture relies. With
arrays as small as 4 by 20 the number of NumPy's calls counts, whatever they compute:

- All logarithms of p are taken in one call.
- x_h(m) = ln L_h(m) serves both Z_h and P(m | h). Neither can overflow: with MOST_POOLED observers, and a prior that
  gives each answer 1e-9 or more, (Z_h/Z_0)^BETA stays below 1e300.
- Each hypothesis is normalised by its factor in the average, not by itself.
- Each pair of observers is compared once, by products with matrices of 0, 1 and -1, which also add up the correlations.
- Sums are products with ones: `dot` begins in half the time of `add.reduce`.
- A few numbers, as the probabilities of the hypotheses, are computed in plain Python.

Dimensions: S scenes, N observers, M answers, H hypotheses, P pairs of observers; `...` is S or nothing.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from common.probability import SMALLEST, Floats
from fusion.engine.guarded_product import BETA, EPSILON, GAMMA, ODDS_OF_FOUR, ODDS_OF_THREE, believed_by
from fusion.engine.weighing import (
    LEAST_LOG_SIZE,
    LOG_FLOOR,
    NATS_TO_BITS,
    PARTICIPATION_BITS,
    SIMILARITY_SCALE,
    UNCERTAIN_MASS,
    ObserverTrust,
    RuleResult,
    off_diagonal,
)

MOST_POOLED = 16
"""For more observers the matrices of pairs are large, and the plain form is as quick."""
SURE = 1.0 - 2.0 * UNCERTAIN_MASS
"""Of two that are certain of one label together, each is surer of it than this."""
ZERO, ONE, D0_SQUARED, TINY, EXPONENT = map(np.array, (0.0, 1.0, PARTICIPATION_BITS**2, SMALLEST, GAMMA - 1.0))
"""Arrays of no dimension: beside an array NumPy takes them in two thirds of the time of a Python number."""
TO_EXPONENT = -SIMILARITY_SCALE / 2.0
UNINFORMED = 2.0 * LEAST_LOG_SIZE * TO_EXPONENT
"""A pair whose size in these units (negative) is not below this has no information: both are at the prior."""
Product = Callable[[Floats, Floats], Floats]


@dataclass(frozen=True, slots=True)
class _Products:
    """Matrix products of one scene, or of many: NumPy begins twice as fast with one (`dot`).

    matrices: (..., A, B) (..., B, C) -> (..., A, C). of_each: (..., A, B) (..., B) -> (..., A). average: (..., A)
    (..., A, B) -> (..., B).
    """

    matrices: Product
    of_each: Product
    average: Product


ONE_SCENE = _Products(np.dot, np.dot, np.dot)
MANY_SCENES = _Products(
    np.matmul, lambda a, b: np.matmul(a, b[..., None])[..., 0], lambda a, b: np.matmul(a[..., None, :], b)[..., 0, :]
)


def guarded_pool(p: Floats, prior: Floats, observers: ObserverTrust) -> RuleResult:
    """(..., N, M) posteriors, (M,) prior -> the pooled p (..., M), and shares (..., N). N is at most MOST_POOLED."""
    products = ONE_SCENE if p.ndim == 2 else MANY_SCENES
    fixed = _fixed(p.shape[-2], prior.tobytes(), p.ndim)
    logs = np.log(p * fixed.scale + fixed.offset)
    bits = np.maximum(products.matrices(p * logs[0], fixed.to_bits), ZERO)
    w = _exponents(p, logs[2], bits, observers, fixed, products)
    x = products.matrices(w, logs[1])
    hypotheses = _hypotheses(bits, products.matrices(np.exp(x), prior))
    effective_number = (products.of_each(w, bits) ** 2 + D0_SQUARED) / (products.of_each(w, bits * bits) + D0_SQUARED)
    factor = np.power(np.maximum(effective_number, ONE), EXPONENT)
    mass = np.exp(factor[..., None] * x)
    pooled = products.average(hypotheses / products.matrices(mass, prior), mass) * prior
    information = products.average(hypotheses * factor, w) * bits + TINY
    return RuleResult(pooled, information / _total(information))


def _total(information: Floats) -> float | Floats:
    """(..., N) -> the sum of each scene, to the same bits for one as for many; a product with ones has other bits."""
    if information.ndim == 1:
        return float(sum(information.tolist()))
    return np.array([sum(scene) for scene in information.tolist()])[:, None]


def _exponents(
    p: Floats, logs: Floats, bits: Floats, observers: ObserverTrust, fixed: "_Fixed", products: _Products
) -> Floats:
    """(..., H, N) w (2). logs: of the posteriors over the prior, with LOG_FLOOR; bits (..., N): their divergence."""
    size = p.shape[-2]
    if size == 1:
        return observers.trust[..., None, :] * fixed.believed
    rho = _pair_correlations(p, logs, fixed, products)
    if observers.has_correlations:
        participation = np.minimum(bits / PARTICIPATION_BITS, 1.0)
        pairs = rho.take(fixed.place, axis=-1) * off_diagonal(size)
        learned = observers.correlations * participation[..., None]
        correlation_sums = products.matrices(fixed.believed, np.maximum(pairs, learned))
    else:
        correlation_sums = products.of_each(fixed.correlation_sums, rho).reshape(rho.shape[:-1] + fixed.believed.shape)
    w = fixed.believed / (ONE + correlation_sums)
    return w * observers.trust[..., None, :] if observers.has_trust else w


def _pair_correlations(p: Floats, logs: Floats, fixed: "_Fixed", products: _Products) -> Floats:
    """(..., P) rho of each pair: `similarity` times `uncertainty`."""
    size = p.shape[-2]
    sums = products.matrices(np.abs(products.matrices(fixed.singles_and_differences, logs)), fixed.ones)
    # The size of both of a pair, times TO_EXPONENT: distance / sizes is then the exponent of `similarity`.
    sizes, distance = products.of_each(fixed.sizes, sums[..., :size]), sums[..., size:]
    if sizes.item(sizes.argmax()) < UNINFORMED:
        rho: Floats = np.exp(distance / sizes)
    else:
        # Of two observers at the prior the distance is 1.
        exponents = np.where(sizes < UNINFORMED, distance / np.minimum(sizes, UNINFORMED), -1.0 / SIMILARITY_SCALE)
        rho = np.exp(exponents)
    if p.ndim == 2:
        _discount_certainty(p, rho, fixed)
    else:
        for scene, own in zip(p, rho, strict=True):
            _discount_certainty(scene, own, fixed)
    return rho


def _discount_certainty(p: Floats, rho: Floats, fixed: "_Fixed") -> None:
    """Multiply rho (P,) of pairs that are certain of the same label by their `uncertainty`; p (N, M), one scene."""
    labels = p.argmax(1).tolist()
    if len(set(labels)) == len(labels):
        return
    sure = [(n, label, top) for n, label in enumerate(labels) if (top := p.item(n, label)) > SURE]
    for count, (n, label, top) in enumerate(sure):
        for other, other_label, other_top in sure[:count]:
            if label == other_label:
                rho[fixed.place[n, other]] *= min((2.0 - top - other_top) / (2.0 * UNCERTAIN_MASS), 1.0)


def _hypotheses(bits: Floats, z: Floats) -> Floats:
    """P(h), (..., H). bits (..., N): divergence of each observer; z (..., H): Z_h."""
    if bits.ndim == 1:
        return np.array(_posterior_odds(bits.tolist(), z.tolist()))
    return np.array([_posterior_odds(*scene) for scene in zip(bits.tolist(), z.tolist(), strict=True)])


def _posterior_odds(bits: list[float], z: list[float]) -> list[float]:
    """P(h) of the H hypotheses (1), of one scene. bits (N,): divergence of each observer; z (H,): Z_h."""
    if len(z) == 1:
        return [1.0]
    z_none_wrong, participants, doubts = z[0], 0.0, []
    for divergence_bits, z_one_wrong in zip(bits, z[1:], strict=True):
        participation = 1.0 if divergence_bits >= PARTICIPATION_BITS else divergence_bits / PARTICIPATION_BITS
        participants += participation
        doubts.append(participation * (z_one_wrong / z_none_wrong) ** BETA)
    odds = ODDS_OF_FOUR
    if participants < 4.0:
        odds = ODDS_OF_THREE * min(max(participants - 2.0, 0.0), 1.0)
        odds += (ODDS_OF_FOUR - ODDS_OF_THREE) * max(participants - 3.0, 0.0)
    none_wrong = 1.0 / (1.0 + odds * sum(doubts))
    return [none_wrong, *[odds * none_wrong * doubt for doubt in doubts]]


@dataclass(frozen=True, slots=True)
class _Fixed:
    """Arrays that depend on the prior and on the number of observers alone.

    scale, offset (3, ..., N, M), with one scene: p times scale plus offset is p/prior, kept above 0; (1-eps) p/prior +
    eps; and the same with LOG_FLOOR. to_bits, ones (M,): products with them are sums, the first from natural logs to
    bits. believed (H, N). singles_and_differences (N + P, N): each observer, and then the difference of each
    pair. sizes (P, N): the sum of a pair's sizes, times TO_EXPONENT. place (N, N): the number of the pair of two
    observers; any for one with itself. correlation_sums (H N, P): its product with rho (P,) is the sum of rho of each
    observer with the others that each hypothesis believes.
    """

    scale: Floats
    offset: Floats
    to_bits: Floats
    ones: Floats
    believed: Floats
    sizes: Floats
    singles_and_differences: Floats
    place: np.ndarray[tuple[int, ...], np.dtype[np.intp]]
    correlation_sums: Floats


@lru_cache(maxsize=64)
def _fixed(size: int, prior_bytes: bytes, dimensions: int) -> _Fixed:
    """For `size` observers. prior_bytes: the prior as bytes, because an array cannot be a key of the cache."""
    prior, believed = np.frombuffer(prior_bytes), believed_by(size)
    weights, offsets = np.array([1.0, 1.0 - EPSILON, 1.0 - LOG_FLOOR]), np.array([SMALLEST, EPSILON, LOG_FLOOR])
    first, second = np.triu_indices(size, 1)
    pairs = np.arange(len(first))
    differences, place = np.zeros((len(first), size)), np.zeros((size, size), dtype=np.intp)
    differences[pairs, first], differences[pairs, second] = 1.0, -1.0
    place[first, second] = place[second, first] = pairs
    correlation_sums = np.zeros((*believed.shape, len(first)))
    for pair, (one, other) in enumerate(zip(first, second, strict=True)):
        correlation_sums[:, one, pair], correlation_sums[:, other, pair] = believed[:, other], believed[:, one]
    # In full, because NumPy needs twice as long to repeat a row or a number.
    axes, full = (3, *[1] * dimensions), (3, *[1] * (dimensions - 2), size, len(prior))
    return _Fixed(
        np.broadcast_to(weights.reshape(axes) * (1.0 / prior), full).copy(),
        np.broadcast_to(offsets.reshape(axes), full).copy(),
        np.full(len(prior), NATS_TO_BITS),
        np.ones(len(prior)),
        believed,
        TO_EXPONENT * np.abs(differences),
        np.concatenate((np.eye(size), differences)),
        place,
        correlation_sums.reshape(believed.size, len(first)),
    )
