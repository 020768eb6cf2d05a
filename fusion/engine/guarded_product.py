"""The default rule: Bayes' product, guarded against one observer that is plainly wrong. Pure.

The design: fusion.md, "The default". N observers, M answers. Arrays may have leading axes, written `...`: one scene per
entry, each pooled by itself.

Hypothesis 0 says that every observer can be believed, hypothesis i that observer i is plainly wrong: its posterior has
nothing to do with the movement, and is left out. The result is the average over the N + 1 hypotheses,

    P(m) = sum_h P(h) P(m | h),    P(m | h) proportional to prior(m) L_h(m)^(W_h^(gamma-1)),
    L_h(m) = prod_{i not h} (p~_i(m)/prior(m))^w_ih,    p~_i = (1 - eps) p_i + eps prior.

1. P(h) is proportional to odds_h Z_h^BETA with Z_h = sum_m prior(m) L_h(m), so that doubt follows evidence; odds_i rise
   as observer i loses trust (trust.py). Z_0/Z_i is the Bayes factor of observer i's posterior against a random one,
   given all others. Observers that agree raise Z_0 by far more than the odds, and the result is their product. One that
   contradicts the others is left out, the more surely the surer it and they are. Two that differ can only doubt each
   other, so doubt needs three that participate.
2. w_ih = t_i / (1 + sum_j rho_ji) over the others j that h believes. t is the trust (trust.py). rho
   is the correlation: near 1 for posteriors that are the same, unless both are certain, or learned from verdicts
   (trust.py), the latter in proportion to the participation of j.
3. W_h = (D0^2 + (sum_i w_ih D_i)^2) / (D0^2 + sum_i w_ih D_i^2), with D the divergence from the prior and D0 =
   PARTICIPATION_BITS: the effective number of observers, N if all say as much, 1 if one says nearly everything. Several
   views of one person are not independent, and with GAMMA they are right as often as they claim. W below 1 counts as 1.
4. eps bounds a veto: with one observer less, the log odds of two answers differ by at most ln(1 + M (1-eps)/eps).

An observer whose posterior is the prior does not participate and changes nothing. All of this changes smoothly with the
number of participants. Averaging over which observation is an outlier: Box and Tiao, "A Bayesian approach to some
outlier problems", Biometrika 55, 1968. The constants were chosen on people left out one at a time.

Many scenes are pooled to the same bits as each alone, on which a replayed capture relies. With arrays as small as 4 by
20 the number of NumPy's calls counts, whatever they compute:

- All logarithms of p are taken in one call; x_h(m) = ln L_h(m) serves both Z_h and P(m | h).
- Each hypothesis is normalised by its factor in the average, not by itself.
- Each pair of observers is compared once, by products with matrices of 0, 1 and -1, which also add up the correlations.
- Sums are products with ones: `dot` begins in half the time of `add.reduce`.
- A few numbers, as the probabilities of the hypotheses, are computed in plain Python.

Tests compare it with the plain form. S scenes, N observers, M answers, H hypotheses, P pairs; `...` is S or nothing.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np

from common.probability import SMALLEST, Floats
from fusion.engine.trust import odds_of_fault
from fusion.engine.weighing import (
    CERTAIN_MASS,
    LEAST_LOG_SIZE,
    LOG_FLOOR,
    NATS_TO_BITS,
    PARTICIPATION_BITS,
    SIMILARITY_SCALE,
    ObserverTrust,
    PoolingWeights,
    RuleResult,
    off_diagonal,
    similarity,
    uncertainty,
)

EPSILON = 0.02
"""eps: share of the prior in p~."""
FAULT_PROBABILITY = (0.05, 0.3)
"""Prior probability that an observer is plainly wrong, for three, and for four and more participants.

Two of three agree by mistake more often than three of four.
"""
ODDS_OF_THREE, ODDS_OF_FOUR = (probability / (1.0 - probability) for probability in FAULT_PROBABILITY)
GAMMA = 0.45
"""Chosen with BETA and FAULT_PROBABILITY: with this exponent, the result is right as often as it claims."""
BETA = 2.0
"""The evidence for a hypothesis counts twice, because an honest observer is rarely both sure and contradicted."""
MOST_PAIRED = 16
"""For more observers the matrices of pairs are large, and products of likelihoods may overflow."""
BOTH_SURE = 1.0 - 2.0 * CERTAIN_MASS
"""Of two that are certain of one label together, each is surer of it than this."""
ZERO, ONE, D0_SQUARED, TINY, EXPONENT = map(np.array, (0.0, 1.0, PARTICIPATION_BITS**2, SMALLEST, GAMMA - 1.0))
"""Arrays of no dimension: beside an array NumPy takes them in two thirds of the time of a Python number."""
TO_EXPONENT = -SIMILARITY_SCALE / 2.0
UNINFORMED = 2.0 * LEAST_LOG_SIZE * TO_EXPONENT
"""A pair whose size in these units (negative) is not below this has no information: both are at the prior."""
BAYES_FACTOR_LIMIT = 1e150
"""Its square is finite."""
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


def guarded_product(p: Floats, prior: Floats, observers: ObserverTrust) -> RuleResult:
    """(..., N, M) posteriors, (M,) prior -> the pooled p (..., M), and shares (..., N)."""
    is_many, products = p.shape[-2] > MOST_PAIRED, ONE_SCENE if p.ndim == 2 else MANY_SCENES
    if is_many and p.ndim == 3:
        # Many scenes of many observers together would differ from each alone in the last bits.
        trusts = [ObserverTrust(*scene) for scene in zip(observers.trust, observers.correlations, strict=True)]
        results = [guarded_product(scene, prior, own) for scene, own in zip(p, trusts, strict=True)]
        return RuleResult(np.array([result.p for result in results]), np.array([result.weights for result in results]))
    w, x, hypotheses, factor, bits = _weigh(p, prior, observers, products)
    logs = factor[..., None] * x
    mass = np.exp(logs - logs.max(axis=-1, keepdims=True) if is_many else logs)
    pooled = products.average(hypotheses / products.matrices(mass, prior), mass) * prior
    return RuleResult(pooled, _shares(products.average(hypotheses * factor, w), bits))


def guarded_weights(p: Floats, prior: Floats, observers: ObserverTrust) -> PoolingWeights:
    """(..., N, M) posteriors, (M,) prior -> exponents (..., H, N) and probabilities of H hypotheses: N + 1, or 1."""
    products = ONE_SCENE if p.ndim == 2 else MANY_SCENES
    w, _, hypotheses, factor, bits = _weigh(p, prior, observers, products)
    shares = _shares(products.average(hypotheses * factor, w), bits)
    return PoolingWeights(w * factor[..., None], np.full(p.shape[:-1], EPSILON), shares, hypotheses)


def _weigh(
    p: Floats, prior: Floats, observers: ObserverTrust, products: _Products
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """w (..., H, N) (2); x (..., H, M) = ln L_h(m); P(h) and W^(gamma-1) (3), (..., H); bits (..., N)."""
    fixed = _fixed(p.shape[-2], prior.tobytes(), p.ndim)
    logs = np.log(p * fixed.scale + fixed.offset)
    bits = np.maximum(products.matrices(p * logs[0], fixed.to_bits), ZERO)
    w = _exponents(p, logs[2], bits, observers, fixed, products)
    x = products.matrices(w, logs[1])
    z = products.matrices(np.exp(x if p.shape[-2] <= MOST_PAIRED else x - x.max()), prior)
    effective_number = (products.of_each(w, bits) ** 2 + D0_SQUARED) / (products.of_each(w, bits * bits) + D0_SQUARED)
    return w, x, _hypotheses(bits, z, observers.trust), np.power(np.maximum(effective_number, ONE), EXPONENT), bits


def _shares(mean_exponents: Floats, bits: Floats) -> Floats:
    """(..., N) how much each observer is heard, summing to 1."""
    information = mean_exponents * bits + TINY
    shares: Floats = information / _total(information)
    return shares


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
    is_many = size > MOST_PAIRED
    rho = similarity(p * fixed.scale[0]) * uncertainty(p) if is_many else _pair_correlations(p, logs, fixed, products)
    if observers.has_correlations or is_many:
        participation = np.minimum(bits / PARTICIPATION_BITS, 1.0)
        pairs = rho if is_many else rho.take(fixed.place, axis=-1) * off_diagonal(size)
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
    sure = [(n, label, top) for n, label in enumerate(labels) if (top := p.item(n, label)) > BOTH_SURE]
    for count, (n, label, top) in enumerate(sure):
        for other, other_label, other_top in sure[:count]:
            if label == other_label:
                rho[fixed.place[n, other]] *= min((2.0 - top - other_top) / (2.0 * CERTAIN_MASS), 1.0)


def _hypotheses(bits: Floats, z: Floats, trust: Floats) -> Floats:
    """P(h), (..., H). bits (..., N): divergence of each observer; z (..., H): Z_h; trust (..., N)."""
    if bits.ndim == 1:
        return np.array(_posterior_odds(bits.tolist(), z.tolist(), trust.tolist()))
    scenes = zip(bits.tolist(), z.tolist(), np.broadcast_to(trust, bits.shape).tolist(), strict=True)
    return np.array([_posterior_odds(*scene) for scene in scenes])


def _posterior_odds(bits: list[float], z: list[float], trust: list[float]) -> list[float]:
    """P(h) of the H hypotheses (1), of one scene. bits (N,): divergence of each observer; z (H,): Z_h; trust (N,)."""
    if len(z) == 1:
        return [1.0]
    z_none_wrong, participants, doubts = max(z[0], SMALLEST), 0.0, []
    for divergence_bits, z_one_wrong, trusted in zip(bits, z[1:], trust, strict=True):
        participation = 1.0 if divergence_bits >= PARTICIPATION_BITS else divergence_bits / PARTICIPATION_BITS
        participants += participation
        ratio = z_one_wrong / z_none_wrong
        doubt = participation * (ratio if ratio < BAYES_FACTOR_LIMIT else BAYES_FACTOR_LIMIT) ** BETA
        doubts.append(doubt if trusted == 1.0 else doubt * odds_of_fault(trusted))
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
    first, second = np.triu_indices(size if size <= MOST_PAIRED else 1, 1)
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


@cache
def believed_by(size: int) -> Floats:
    """(H, N): 1 for an observer that the hypothesis believes. Fewer than three observers leave only hypothesis 0."""
    none_wrong = np.ones((1, size))
    return none_wrong if size < 3 else np.concatenate([none_wrong, off_diagonal(size)])
