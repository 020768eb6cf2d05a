"""The default rule for movements alone, in a third of the time of its plain form. Pure.

The formulas stand in guarded_product.py. The result is that of `guarded_strengths` and `averaged_log_mix` to 1e-12;
tests compare them. Many scenes are pooled to the same bits as each alone, on which a replayed capture relies. With
arrays as small as 4 by 20 the number of NumPy's calls counts, whatever they compute:

- All logarithms of p are taken in one call.
- x_h(m) = ln L_h(m) serves both Z_h and P(m | h). Neither can overflow: with MOST_POOLED observers, and a prior that
  gives each answer 1e-9 or more, (Z_h/Z_0)^BETA stays below 1e300.
- Each hypothesis is normalised by its factor in the average, not by itself.
- Each pair of observers is compared once, by products with matrices of 0 and 1, which also add up the shared voices.
- Sums are products with ones: `dot` begins in half the time of `add.reduce`.
- What concerns a few numbers, as the probabilities of the hypotheses, is computed in plain Python.

Dimensions: S scenes, N observers, M answers, H hypotheses, P pairs of observers; `...` is S or nothing.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from common.probability import SMALLEST, Floats
from fusion.engine.guarded_product import BETA, EPSILON, GAMMA, ODDS_OF_FOUR, ODDS_OF_THREE, believed_by
from fusion.engine.strengths import (
    LEAST_SIZE,
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
"""Only two that are both surer than this of one label can be certain of it together."""
ZERO, ONE, D0_SQUARED, TINY, EXPONENT = map(np.array, (0.0, 1.0, PARTICIPATION_BITS**2, SMALLEST, GAMMA - 1.0))
"""Arrays of no dimension: beside an array NumPy takes them in two thirds of the time of a Python number."""
TO_SIZES = -SIMILARITY_SCALE / 2.0
KNOWS_NOTHING = 2.0 * LEAST_SIZE * TO_SIZES
"""The size of a pair from which on (it is negative) the two know nothing."""
Product = Callable[[Floats, Floats], Floats]


@dataclass(frozen=True, slots=True)
class _Products:
    """NumPy multiplies each of many scenes as it does one, but begins twice as fast with one (`dot`).

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
    times = ONE_SCENE if p.ndim == 2 else MANY_SCENES
    fixed = _fixed(p.shape[-2], prior.tobytes(), p.ndim)
    logs = np.log(p * fixed.scale + fixed.offset)
    bits = np.maximum(times.matrices(p * logs[0], fixed.to_bits), ZERO)
    w = _exponents(p, logs[2], bits, observers, fixed, times)
    x = times.matrices(w, logs[1])
    hypotheses = _hypotheses(bits, times.matrices(np.exp(x), prior))
    number = (times.of_each(w, bits) ** 2 + D0_SQUARED) / (times.of_each(w, bits * bits) + D0_SQUARED)
    factor = np.power(np.maximum(number, ONE), EXPONENT)
    mass = np.exp(factor[..., None] * x)
    pooled = times.average(hypotheses / times.matrices(mass, prior), mass) * prior
    evidence = times.average(hypotheses * factor, w) * bits + TINY
    return RuleResult(pooled, evidence / _total(evidence))


def _total(evidence: Floats) -> float | Floats:
    """(..., N) -> the sum of each scene: to the same bits for one as for many, which a product with ones has not."""
    if evidence.ndim == 1:
        return float(sum(evidence.tolist()))
    return np.array([sum(scene) for scene in evidence.tolist()])[:, None]


def _exponents(
    p: Floats, logs: Floats, bits: Floats, observers: ObserverTrust, fixed: "_Fixed", times: _Products
) -> Floats:
    """(..., H, N) w. logs: of the posteriors over the prior, with LOG_FLOOR; bits (..., N): their divergence."""
    size = p.shape[-2]
    if size == 1:
        return observers.trust[..., None, :] * fixed.believed
    rho = _shared_voice(p, logs, fixed, times)
    if observers.has_correlations:
        part = np.minimum(bits / PARTICIPATION_BITS, 1.0)
        pairs = rho.take(fixed.place, axis=-1) * off_diagonal(size)
        voices = times.matrices(fixed.believed, np.maximum(pairs, observers.correlations * part[..., None]))
    else:
        voices = times.of_each(fixed.voices, rho).reshape(rho.shape[:-1] + fixed.believed.shape)
    w = fixed.believed / (ONE + voices)
    return w * observers.trust[..., None, :] if observers.has_trust else w


def _shared_voice(p: Floats, logs: Floats, fixed: "_Fixed", times: _Products) -> Floats:
    """(..., P) rho of posteriors that are the same, unless both are certain: `similarity` times `uncertainty`."""
    size = p.shape[-2]
    sums = times.matrices(np.abs(times.matrices(fixed.singles_and_differences, logs)), fixed.ones)
    # Both sizes of a pair together, over -SIMILARITY_SCALE / 2.
    sizes, distance = times.of_each(fixed.sizes, sums[..., :size]), sums[..., size:]
    if sizes.item(sizes.argmax()) < KNOWS_NOTHING:
        rho: Floats = np.exp(distance / sizes)
    else:
        # Of two observers that know nothing the distance is 1.
        exponents = np.where(
            sizes < KNOWS_NOTHING, distance / np.minimum(sizes, KNOWS_NOTHING), -1.0 / SIMILARITY_SCALE
        )
        rho = np.exp(exponents)
    if p.ndim == 2:
        _trust_certain(p, rho, fixed)
    else:
        for scene, own in zip(p, rho, strict=True):
            _trust_certain(scene, own, fixed)
    return rho


def _trust_certain(p: Floats, rho: Floats, fixed: "_Fixed") -> None:
    """Lower rho (P,) of two that are certain of the same, by `uncertainty`; p (N, M), one scene."""
    labels = p.argmax(1).tolist()
    if len(set(labels)) == len(labels):
        return
    sure = [(n, label, top) for n, label in enumerate(labels) if (top := p.item(n, label)) > SURE]
    for place, (n, label, top) in enumerate(sure):
        for other, other_label, other_top in sure[:place]:
            if label == other_label:
                rho[fixed.place[n, other]] *= min((2.0 - top - other_top) / (2.0 * UNCERTAIN_MASS), 1.0)


def _hypotheses(bits: Floats, z: Floats) -> Floats:
    """P(h), (..., H), of the divergence of each observer, and Z_h."""
    if bits.ndim == 1:
        return np.array(_posterior_odds(bits.tolist(), z.tolist()))
    return np.array([_posterior_odds(*scene) for scene in zip(bits.tolist(), z.tolist(), strict=True)])


def _posterior_odds(bits: list[float], z: list[float]) -> list[float]:
    """P(h) of the H hypotheses (1), of one scene."""
    if len(z) == 1:
        return [1.0]
    everybody, number, doubt = z[0], 0.0, []
    for each, one_wrong in zip(bits, z[1:], strict=True):
        part = 1.0 if each >= PARTICIPATION_BITS else each / PARTICIPATION_BITS
        number += part
        doubt.append(part * (one_wrong / everybody) ** BETA)
    odds = ODDS_OF_FOUR
    if number < 4.0:
        odds = ODDS_OF_THREE * min(max(number - 2.0, 0.0), 1.0)
        odds += (ODDS_OF_FOUR - ODDS_OF_THREE) * max(number - 3.0, 0.0)
    share = 1.0 / (1.0 + odds * sum(doubt))
    return [share, *[odds * share * each for each in doubt]]


@dataclass(frozen=True, slots=True)
class _Fixed:
    """What depends on the prior and on the number of observers alone.

    scale, offset (3, ..., N, M), with one scene: p times scale plus offset is p/prior, kept above 0; (1-eps) p/prior +
    eps; and the same with LOG_FLOOR. to_bits, ones (M,): products with them are sums, the first from natural logs to
    bits. believed (H, N). singles_and_differences (N + P, N): each observer, and then the difference of each
    pair. sizes (P, N): the sum of a pair's sizes, times TO_SIZES. place (N, N): the pair of two observers, any of one
    with itself. voices (H N, P): the pairs that share the voice of each observer, under each hypothesis.
    """

    scale: Floats
    offset: Floats
    to_bits: Floats
    ones: Floats
    believed: Floats
    sizes: Floats
    singles_and_differences: Floats
    place: np.ndarray[tuple[int, ...], np.dtype[np.intp]]
    voices: Floats


@lru_cache(maxsize=64)
def _fixed(size: int, prior_bytes: bytes, dimensions: int) -> _Fixed:
    """For `size` observers, and the prior as bytes: an array cannot be looked up."""
    prior, believed = np.frombuffer(prior_bytes), believed_by(size)
    weights, offsets = np.array([1.0, 1.0 - EPSILON, 1.0 - LOG_FLOOR]), np.array([SMALLEST, EPSILON, LOG_FLOOR])
    first, second = np.triu_indices(size, 1)
    number = np.arange(len(first))
    differences, place = np.zeros((len(first), size)), np.zeros((size, size), dtype=np.intp)
    differences[number, first], differences[number, second] = 1.0, -1.0
    place[first, second] = place[second, first] = number
    voices = np.zeros((*believed.shape, len(first)))
    for pair, (one, other) in enumerate(zip(first, second, strict=True)):
        voices[:, one, pair], voices[:, other, pair] = believed[:, other], believed[:, one]
    # In full, because NumPy needs twice as long to repeat a row or a number.
    axes, full = (3, *[1] * dimensions), (3, *[1] * (dimensions - 2), size, len(prior))
    return _Fixed(
        np.broadcast_to(weights.reshape(axes) * (1.0 / prior), full).copy(),
        np.broadcast_to(offsets.reshape(axes), full).copy(),
        np.full(len(prior), NATS_TO_BITS),
        np.ones(len(prior)),
        believed,
        TO_SIZES * np.abs(differences),
        np.concatenate((np.eye(size), differences)),
        place,
        voices.reshape(believed.size, len(first)),
    )
