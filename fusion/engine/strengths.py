"""With what strength each judge's evidence counts in the default rule. Pure; N judges, M movements.

All arrays may have leading axes, written ...: as many scenes as they say are weighed at once, each for itself.

w_i = c_i s_i r_i t_i / d_i . W^(gamma-1), applied to the evidence ln(p~_i/prior), p~ = (1-eps_i) p + eps_i prior, where

1. c: certainty, the inverse entropy of p~ over its mean of those who take part, at most CAP.
2. s: nobody is much surer than all the others: what he says (his divergence from the prior, in bits) counts up to
   SURER times what the next surest says. He sees the same movement at the same time.
3. r = min(1, o)^2 with o = sum_m q(m) p_i(m)/prior(m), q what the others together say: the likelihood of his words if
   they are right, against that of words at random (Bayes' factor). It lowers who is contradicted, raises nobody.
4. eps: how likely he is to be plainly wrong; o says it anew: eps_i = eps / (eps + (1-eps) o).
5. t: trust that was learned (lessons.py), at most 1.
6. d = 1 + sum_j rho_ij: who says the very same as another, or was learned to see with the same eyes, shares one voice,
   unless both are certain.
7. W = sum_i w_i before the last factor, if that is more than 1: what several see of one person is not independent.

Rules 2 to 4 need three who take part, as two can only doubt each other; eps grows with their number for the same
reason. Who knows nothing takes no part: all of it passes smoothly from one number to the next.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from common.probability import Floats
from fusion.engine.weights import ENTROPY_FLOOR_BITS

TAKES_PART_BITS = 0.05
"""Who differs from the prior by this much takes part whole; by less, in proportion."""
ROBUSTNESS = (0.01, 0.05, 0.2)
"""eps for one, two, and three or more who take part: how often a judge may be plainly wrong; in between linear."""
DOUBT = 0.2
"""eps of the others in rule 3: of what they say against a judge."""
ROUNDS = 2
"""Who is contradicted contradicts less: so often the r are computed anew."""
CAP = 2.0
SURER = 1.2
GAMMA = 0.5
"""Fitted, like eps, with people left out one at a time, so that four views are as sure as they are right."""
SAME = 0.05
"""Beliefs that differ by this share of what they say are much the same: rho falls to 1/e."""
UNSURE = 0.03
"""Two whose mean belief leaves less than this to other labels are certain."""
LOG_FLOOR = 0.01
SMALLEST = 1e-300


@dataclass(frozen=True, slots=True)
class ObserverTrust:
    """What is known of N observers: trust (..., N), 0 to 1; correlations (..., N, N), symmetric."""

    trust: Floats
    correlations: Floats

    @staticmethod
    def unknown(size: int) -> "ObserverTrust":
        """Nothing was learned: everybody is trusted and sees with his own eyes."""
        return ObserverTrust(np.ones(size), np.zeros((size, size)))

    @staticmethod
    def together(scenes: Sequence["ObserverTrust"]) -> "ObserverTrust":
        """Those of several scenes with as many judges each, along a new first axis."""
        return ObserverTrust(np.array([s.trust for s in scenes]), np.array([s.correlations for s in scenes]))

    def of(self, places: Sequence[int]) -> "ObserverTrust":
        """That of some judges of one scene."""
        return ObserverTrust(self.trust[list(places)], self.correlations[np.ix_(places, places)])


@dataclass(frozen=True, slots=True)
class Strengths:
    """How each judge counts, all (..., N).

    exponents: of his evidence. epsilon: how far his belief is mixed with the prior before. shares: his part in the
    whole, summing to 1: in the default rule that in all that is said.
    """

    exponents: Floats
    epsilon: Floats
    shares: Floats


def strengths(p: Floats, prior: Floats, standing: ObserverTrust) -> Strengths:
    """(..., N, M) beliefs, (M,) prior -> how each counts."""
    ratio = p / prior
    said_bits = np.maximum(_along(p * np.log2(np.maximum(ratio, SMALLEST))), 0.0)
    part = np.minimum(said_bits / TAKES_PART_BITS, 1.0)
    number = _along(part)
    # How far what two do applies, and what three do: from 0 with one less to 1.
    confirmed = np.minimum(np.maximum(number - 1.0, 0.0), 1.0)[..., None]
    checked = np.minimum(np.maximum(number - 2.0, 0.0), 1.0)[..., None]
    one, two, three = ROBUSTNESS
    usual = one + (two - one) * confirmed + (three - two) * checked
    w = _certainty(p, prior, part, usual) * standing.trust * _not_much_surer(said_bits) ** checked
    rho = np.maximum(similarity(ratio) * _unsure(p), standing.correlations) * part[..., None, :]
    # Who is alone has no double.
    rho *= (number > 1.0)[..., None, None]
    borne_out = _borne_out(ratio, prior, w, rho)
    kept = np.minimum(borne_out, 1.0) ** (2.0 * checked)
    epsilon = usual / (usual + (1.0 - usual) * borne_out**checked)
    w = w * kept / (1.0 + _along(rho * kept[..., None, :]))
    evidence = w * said_bits
    told = _along(evidence)[..., None]
    return Strengths(
        exponents=w * np.maximum(_along(w * part), 1.0)[..., None] ** (GAMMA - 1.0),
        epsilon=epsilon,
        shares=np.where(told > 0, evidence / np.maximum(told, SMALLEST), 1.0 / p.shape[-2]),
    )


def _certainty(p: Floats, prior: Floats, part: Floats, epsilon: Floats) -> Floats:
    safe = (1.0 - epsilon[..., None]) * p + epsilon[..., None] * prior
    inverse = 1.0 / np.maximum(-_along(safe * np.log2(safe)), ENTROPY_FLOOR_BITS)
    usual = _along(part * inverse)[..., None]
    over_usual = inverse * _along(part)[..., None] / np.maximum(usual, SMALLEST)
    return np.where(usual > 0, np.minimum(over_usual, CAP), 1.0)


def _not_much_surer(said_bits: Floats) -> Floats:
    if said_bits.shape[-1] < 2:
        return np.ones_like(said_bits)
    most_two = np.sort(said_bits, axis=-1)[..., -2:]
    others = np.where(said_bits >= most_two[..., 1:], most_two[..., :1], most_two[..., 1:])
    most: Floats = np.minimum(SURER * others / np.maximum(said_bits, SMALLEST), 1.0)
    return most


def _borne_out(ratio: Floats, prior: Floats, w: Floats, rho: Floats) -> Floats:
    """o of rule 3 for each judge, ROUNDS times: (..., N)."""
    evidence = np.log((1.0 - DOUBT) * ratio + DOUBT)
    log_prior = np.log(prior)
    others = _others(w.shape[-1])
    kept, borne_out = np.ones_like(w), np.ones_like(w)
    for _ in range(ROUNDS):
        # Row i: how the others count when i is not there, who may be the double of one of them.
        doubled = others @ np.swapaxes(rho * kept[..., None, :], -1, -2)
        logs = log_prior + (others * (w * kept)[..., None, :] / (1.0 + doubled)) @ evidence
        q = np.exp(logs - np.maximum.reduce(logs, axis=-1)[..., None])
        borne_out = _along(q * ratio) / _along(q)
        kept = np.minimum(borne_out, 1.0) ** 2
    return borne_out


def _unsure(p: Floats) -> Floats:
    """(..., N, N): 0 for two who are certain of the same, which says nothing of whose eyes they see with; else 1."""
    both = np.maximum.reduce((p[..., :, None, :] + p[..., None, :, :]) / 2, axis=-1)
    unsure: Floats = np.minimum((1.0 - both) / UNSURE, 1.0)
    return unsure


def similarity(ratio: Floats) -> Floats:
    """(..., N, M) beliefs over the prior -> (..., N, N): 1 for the very same, near 0 for who see for themselves."""
    result: Floats = np.exp(log_distance(ratio) / -SAME) * _others(ratio.shape[-2])
    return result


def log_distance(ratio: Floats) -> Floats:
    """(..., N, M) beliefs over the prior -> (..., N, N) mean distance of their logs, over how large these are.

    0 for the same.
    """
    said = np.log((1.0 - LOG_FLOOR) * ratio + LOG_FLOOR)
    much = _along(np.abs(said))
    both = (much[..., :, None] + much[..., None, :]) / 2
    distance = _along(np.abs(said[..., :, None, :] - said[..., None, :, :]))
    # Two who know nothing are no correlations of each other.
    return np.where(both > 1e-9, distance / np.maximum(both, 1e-9), 1.0)


@cache
def _others(size: int) -> Floats:
    """(N, N): 1 for everybody but oneself."""
    return 1.0 - np.eye(size)


def _along(values: Floats) -> Floats:
    """The sum along the last axis, in half the time of `sum`."""
    total: Floats = np.add.reduce(values, axis=-1)
    return total
