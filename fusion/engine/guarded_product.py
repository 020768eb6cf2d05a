"""The default rule: Bayes' product, guarded against one observer that is plainly wrong. Pure.

The formulas and their sources: fusion.md, "The default". S scenes, N observers, M answers, H hypotheses (none, or one,
of the observers is plainly wrong); `...` is S or nothing. Many scenes are pooled to the same bits as each alone, on
which a replayed capture relies.

With arrays as small as 4 by 20 the number of NumPy's calls counts, whatever they compute: sums are products with ones,
and a few numbers, as the probabilities of the hypotheses, are plain Python. Tests compare it with the plain form.
"""

import math
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np

from common.message_types import LABELS_LIMIT
from common.probability import SMALLEST, Floats
from fusion.engine.trust import odds_of_fault
from fusion.engine.weighing import PoolingWeights, RuleResult, Trust

EPSILON = 0.02
"""eps: share of the prior in p~; it bounds a veto, and keeps all logarithms finite."""
FAULT_PROBABILITY = (0.05, 0.3)
"""Prior probability that an observer is plainly wrong, for three, and for four and more participants: two of three
agree by mistake more often than three of four."""
ODDS_OF_FAULT = tuple(probability / (1.0 - probability) for probability in FAULT_PROBABILITY)
GAMMA = 0.45
"""Chosen with BETA and FAULT_PROBABILITY: with this exponent, the result is right as often as it claims."""
BETA = 2.0
"""The evidence for a hypothesis counts twice, because an honest observer is rarely both sure and contradicted."""
PARTICIPATION_BITS = 0.05
"""D0: an observer participates fully from this divergence from the prior, below it in proportion."""
SIMILARITY_SCALE = 0.05
"""Log distance at which rho of two posteriors falls to 1/e."""
CERTAIN_MASS = 0.03
"""Two observers are certain if their mean posterior leaves less than this to all labels but one."""
LEAST_SIZE = np.array(1e-12)
"""Nats; a posterior whose log ratios to the prior add up to less carries no information."""
MOST_FINITE = int(math.log(np.finfo(np.float64).max) / math.log(LABELS_LIMIT))
"""The product of more likelihood ratios, each at most LABELS_LIMIT, may overflow."""
NATS_TO_BITS = 1.0 / math.log(2.0)
ZERO, ONE, D0_SQUARED, TINY, EXPONENT = map(np.array, (0.0, 1.0, PARTICIPATION_BITS**2, SMALLEST, GAMMA - 1.0))
TO_EXPONENT = -2.0 / SIMILARITY_SCALE
LEAST_EXPONENT = LEAST_SIZE * TO_EXPONENT
"""Arrays of no dimension: beside an array NumPy takes them in two thirds of the time of a Python number."""


def guarded_product(p: Floats, prior: Floats, trust: Trust = None, /) -> RuleResult:
    """(..., N, M) posteriors, (M,) prior, trust (..., N) -> the pooled p (..., M), and shares (..., N)."""
    _, x, hypotheses, factor, shares = _weigh(p, prior, trust)
    logs = factor[..., None] * x
    mass = np.exp(logs if p.shape[-2] <= MOST_FINITE else logs - logs.max(axis=-1, keepdims=True))
    # Each hypothesis is normalised by its factor in the average, not by itself.
    total = _times(mass, prior)
    return RuleResult(_average(hypotheses / total, mass) * prior, shares, hypotheses, mass)


def guarded_weights(p: Floats, prior: Floats, trust: Trust) -> PoolingWeights:
    """(N, M) posteriors, (M,) prior -> exponents (H, N) and probabilities of H hypotheses: N + 1, or 1."""
    w, _, hypotheses, factor, shares = _weigh(p, prior, trust)
    return PoolingWeights(w * factor[..., None], np.full(p.shape[:-1], EPSILON), shares, hypotheses)


def _weigh(p: Floats, prior: Floats, trust: Trust) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """w (..., H, N); x (..., H, M) = ln L_h(m); P(h) and W^(gamma-1), (..., H); shares (..., N)."""
    fixed = _fixed(p.shape[-2], prior.tobytes())
    logs = np.log(p * fixed.scale + fixed.offset)
    bits = np.maximum(_times(p * logs, fixed.to_bits), ZERO)
    # Each is correlated with itself, unless it is at the prior.
    w = fixed.believed / np.maximum(_product(fixed.believed, _correlations(p, logs, fixed)), ONE)
    if trust is not None:
        w *= trust[..., None, :]
    x = _product(w, logs)
    z = _times(np.exp(x if p.shape[-2] <= MOST_FINITE else x - x.max(axis=(-2, -1), keepdims=True)), prior)
    effective_number = (_times(w, bits) ** 2 + D0_SQUARED) / (_times(w, bits * bits) + D0_SQUARED)
    factor = np.power(np.maximum(effective_number, ONE), EXPONENT)
    hypotheses = _hypotheses(bits, z, trust)
    information = _average(hypotheses * factor, w) * bits + TINY
    return w, x, hypotheses, factor, information / np.add.reduce(information, axis=-1, keepdims=True)


def _correlations(p: Floats, logs: Floats, fixed: "_Fixed") -> Floats:
    """(..., N, N) rho: 1 for equal posteriors, near 0 for independent ones. logs: of p~/prior."""
    sizes = np.dot(np.abs(logs), fixed.ones) + LEAST_SIZE
    differences = logs[..., :, None, :] - logs[..., None, :, :]
    # The least one: two observers at the prior are not correlated.
    exponents = np.dot(np.abs(differences, out=differences), fixed.to_exponent) + LEAST_EXPONENT
    rho: Floats = np.exp(exponents / (sizes[..., :, None] + sizes[..., None, :]))
    for scene, own in ((p, rho),) if p.ndim == 2 else zip(p, rho, strict=True):
        _discount_certainty(scene, own)
    return rho


def _discount_certainty(p: Floats, rho: Floats) -> None:
    """Lower rho (N, N) of pairs of p (N, M) that are certain of the same label: to be so shows no correlation."""
    labels = p.argmax(1).tolist()
    if len(set(labels)) == len(labels):
        return
    # Of two that are certain of one label together, each is surer of it than this.
    least = 1.0 - 2.0 * CERTAIN_MASS
    sure = [(n, label, top) for n, label in enumerate(labels) if (top := p.item(n, label)) > least]
    for count, (n, label, top) in enumerate(sure):
        for other, other_label, other_top in sure[:count]:
            if label == other_label:
                rho[n, other] *= min((2.0 - top - other_top) / (2.0 * CERTAIN_MASS), 1.0)
                rho[other, n] = rho[n, other]


def _hypotheses(bits: Floats, z: Floats, trust: Trust) -> Floats:
    """P(h), (..., H). bits (..., N): divergence of each observer; z (..., H): Z_h; trust (..., N)."""
    if bits.ndim == 1:
        return np.array(_posterior_odds(bits.tolist(), z.tolist(), None if trust is None else trust.tolist()))
    trusts = [None] * len(bits) if trust is None else trust.tolist()
    return np.array([_posterior_odds(*scene) for scene in zip(bits.tolist(), z.tolist(), trusts, strict=True)])


def _posterior_odds(bits: list[float], z: list[float], trust: list[float] | None) -> list[float]:
    """P(h) of the H hypotheses of one scene."""
    if len(z) == 1:
        return [1.0]
    # Beside the largest one all squares are finite.
    largest, participants, doubts = max(z), 0.0, []
    for n, (divergence_bits, z_one_wrong) in enumerate(zip(bits, z[1:], strict=True)):
        participation = 1.0 if divergence_bits >= PARTICIPATION_BITS else divergence_bits / PARTICIPATION_BITS
        participants += participation
        doubt = participation * (z_one_wrong / largest) ** BETA
        doubts.append(doubt if trust is None or trust[n] == 1.0 else doubt * odds_of_fault(trust[n]))
    of_three, odds = ODDS_OF_FAULT
    if participants < 4.0:
        odds = of_three * min(max(participants - 2.0, 0.0), 1.0) + (odds - of_three) * max(participants - 3.0, 0.0)
    none_wrong = (z[0] / largest) ** BETA
    total = none_wrong + odds * sum(doubts)
    return [none_wrong / total, *[odds * doubt / total for doubt in doubts]]


# NumPy begins twice as fast with the product of two matrices (`dot`) as with many.


def _product(a: Floats, b: Floats) -> Floats:
    """(..., A, B), or (A, B), times (..., B, C)."""
    result: Floats = np.dot(a, b) if b.ndim == 2 else np.matmul(a, b)
    return result


def _times(a: Floats, b: Floats) -> Floats:
    """(..., A, B) times (..., B), or times (B,): (..., A)."""
    result: Floats = np.dot(a, b) if a.ndim == 2 else np.matmul(a, b[..., None])[..., 0]
    return result


def _average(a: Floats, b: Floats) -> Floats:
    """(..., A) times (..., A, B): (..., B)."""
    result: Floats = np.dot(a, b) if b.ndim == 2 else np.matmul(a[..., None, :], b)[..., 0, :]
    return result


class _Fixed(NamedTuple):
    """Arrays that depend on the prior and on the number of observers alone.

    scale, offset (N, M): p times scale plus offset is p~/prior = (1-eps) p/prior + eps. to_bits, ones, to_exponent
    (M,): products with them are sums, the first from natural logs to bits, the last times TO_EXPONENT. believed (H, N):
    1 for an observer that the hypothesis believes.
    """

    scale: Floats
    offset: Floats
    to_bits: Floats
    ones: Floats
    to_exponent: Floats
    believed: Floats


@lru_cache(maxsize=64)
def _fixed(size: int, prior_bytes: bytes) -> _Fixed:
    """For `size` observers. prior_bytes: the prior as bytes, because an array cannot be a key of the cache."""
    prior = np.frombuffer(prior_bytes)
    # In full, because NumPy needs twice as long to repeat a row or a number.
    scale, offset = np.tile((1.0 - EPSILON) / prior, (size, 1)), np.full((size, len(prior)), EPSILON)
    to_bits, ones, to_exponent = (np.full(len(prior), each) for each in (NATS_TO_BITS, 1.0, TO_EXPONENT))
    return _Fixed(scale, offset, to_bits, ones, to_exponent, believed_by(size))


@cache
def believed_by(size: int) -> Floats:
    """(H, N): 1 for an observer that the hypothesis believes. Fewer than three observers leave only hypothesis 0."""
    none_wrong = np.ones((1, size))
    return none_wrong if size < 3 else np.concatenate([none_wrong, 1.0 - np.eye(size)])
