"""How likely something else is, by what people who were left out show. Pure.

The log odds of the classifier are scaled: a penalised regression is too cautious about people whom it has not learned
from. And two members that agree less than they do about learned movements speak for something else. Both scales are
logistic, of least log loss: Platt, "Probabilistic outputs for support vector machines", Advances in Large Margin
Classifiers, 1999.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.model.log_linear_pool import SMALLEST
from observer.model.parameters import POSITIVE, Parameter, ParameterRange
from observer.tracks import Floats

SLOPE, OFFSET = "else_slope", "else_offset"
SCALING: Mapping[str, Parameter] = {  # Learned in cross-validation.
    SLOPE: Parameter(1.0, POSITIVE, earlier=1.0),
    OFFSET: Parameter(0.0, ParameterRange(-20.0, 20.0), earlier=0.0),
}
PRIOR = 10.0
"""Nats for a slope or an offset that is 1 away from its default: with few examples both stay near it."""
STEPS = 30

AGREEMENT_SLOPE, AGREEMENT_OFFSET = "agreement_slope", "agreement_offset"
AGREEMENT: Mapping[str, Parameter] = {  # Learned in cross-validation; both 0: agreement says nothing.
    AGREEMENT_SLOPE: Parameter(0.0, ParameterRange(-20.0, 0.0), earlier=0.0),
    AGREEMENT_OFFSET: Parameter(0.0, ParameterRange(-20.0, 20.0), earlier=0.0),
}
CERTAIN = 1 / 3
"""Examples of each movement about which both members are certain, beside those of people left out."""
AGREEMENT_PRIOR = 1.0
"""As PRIOR: nats for a slope or an offset of agreement that is 1 away from 0."""
FEWEST = 20
"""Movements of people left out; fewer do not tell how far members agree."""
AGREED_FROM = 0.6
"""The share of a movement from which members agree about it, if they know it."""
TOLERATED, STEEP, MOST_NATS = 0.5, 4.0, 9.0
"""Disagreement counts from these log odds on, so many times, and up to so many nats: chosen on people left out."""


@dataclass(frozen=True, slots=True, eq=False)
class ElseRows:
    """(N,) log odds of something else in windows of people left out, how far they show it, and their weights."""

    log_odds: Floats
    targets: Floats
    weights: Floats


def log_odds_of(log_answers: Floats) -> Floats:
    """(..., M + 1) log probabilities of the movements and of something else -> (...) log odds of something else."""
    odds: Floats = log_answers[..., -1] - np.logaddexp.reduce(log_answers[..., :-1], axis=-1)
    return odds


def scaled(log_answers: Floats, parameters: Mapping[str, float]) -> float:
    """(M + 1,) log probabilities, something else last -> P(something else) by the scaled log odds."""
    odds = parameters[SLOPE] * float(log_odds_of(log_answers)) + parameters[OFFSET]
    return 1.0 / (1.0 + math.exp(-min(max(odds, -40.0), 40.0)))


def learn_scaling(
    rows: Sequence[ElseRows], parameters: Mapping[str, float], explicit: Collection[str]
) -> dict[str, float]:
    """The slope and the offset of least log loss; explicit ones stay as they are."""
    odds, targets, weights = (
        np.concatenate([[], *(getattr(r, name) for r in rows)]) for name in ("log_odds", "targets", "weights")
    )
    names = (SLOPE, OFFSET)
    start = np.array([parameters[name] for name in names])
    free = np.array([name not in explicit for name in names])
    solution = _logistic(ElseRows(odds, targets, weights), start, free, PRIOR)
    return dict(zip(names, np.clip(solution, (0.2, -5.0), (5.0, 5.0)).tolist(), strict=True))


def learn_confusions(members: Floats) -> Floats:
    """(N, T, 2, M) posteriors of people left out -> (M, M), 1 on the diagonal: how often one is taken for the other.

    0 is never. Two members that give two movements which are often confused do not disagree much.
    """
    both = np.einsum("nti,ntj->ij", members[:, :, 0], members[:, :, 1]) / max(members.shape[1], 1)
    both = both + both.T + CERTAIN * np.eye(len(both))
    own = np.sqrt(np.diag(both))
    confusions: Floats = np.minimum(both / (own[:, None] * own), 1.0)
    np.fill_diagonal(confusions, 1.0)
    return confusions


def agreement_of(members: Floats, confusions: Floats) -> Floats:
    """(..., 2, M) posteriors of two members -> (...) log of the probability that independent draws from both agree.

    confusions: (M, M), to what extent two different answers agree.
    """
    p = np.maximum(members, SMALLEST)
    p = p / p.sum(axis=-1, keepdims=True)
    agreement: Floats = np.log(((p[..., 0, :] @ confusions) * p[..., 1, :]).sum(axis=-1))
    return agreement


def learn_agreement(
    members: Floats,
    truth: NDArray[np.int64],
    confusions: Floats,
    parameters: Mapping[str, float],
    explicit: Collection[str],
) -> dict[str, float]:
    """(N, T, 2, M) posteriors of N movements of people left out, (N,) the movements -> what disagreement says.

    From the same movements with the right answer struck out of both posteriors: so two members judge a movement that
    neither has learned. Nothing is learned from too few, and if the members then agree no less.
    """
    names = (AGREEMENT_SLOPE, AGREEMENT_OFFSET)
    result = {name: parameters[name] for name in names}
    if len(truth) < FEWEST or members.shape[-1] < 3 or any(name in explicit for name in names):
        return result
    others = np.arange(members.shape[-1]) != truth[:, None]
    struck_out = [
        agreement_of(p[..., other], confusions[np.ix_(other, other)]) for p, other in zip(members, others, strict=True)
    ]
    agreement = np.stack([agreement_of(members, confusions), np.array(struck_out)])
    targets = np.repeat([0.0, 1.0], agreement[0].size)
    rows = ElseRows(agreement.ravel(), targets, np.full(len(targets), 1 / members.shape[1]))
    slope, offset = _logistic(rows, np.zeros(2), np.full(2, True), AGREEMENT_PRIOR)
    return result if slope >= 0 else dict(zip(names, np.clip([slope, offset], -20, (0, 20)).tolist(), strict=True))


def disagreement(members: Floats, confusions: Floats, parameters: Mapping[str, float]) -> float:
    """(2, M) posteriors -> nats for something else, from 0 to MOST_NATS."""
    slope, offset = parameters[AGREEMENT_SLOPE], parameters[AGREEMENT_OFFSET]
    if not slope:
        return 0.0
    nats = STEEP * (slope * float(agreement_of(members, confusions)) + offset - TOLERATED)
    return min(max(nats, 0.0), MOST_NATS)


def add_log_odds(p: float, nats: float) -> float:
    """The probability of what so many nats speak for."""
    odds = math.exp(nats)
    return p * odds / (1.0 - p + p * odds) if nats else p


def _logistic(rows: ElseRows, start: Floats, free: NDArray[np.bool_], prior: float) -> Floats:
    """Slope and offset of least log loss plus `prior` times the squared distance from the start, by Newton's method."""
    design, solution = np.stack([rows.log_odds, np.ones(len(rows.log_odds))], axis=1), start.copy()
    for _ in range(STEPS):
        p = 1.0 / (1.0 + np.exp(-np.clip(design @ solution, -40, 40)))
        gradient = design.T @ (rows.weights * (p - rows.targets)) + 2 * prior * (solution - start)
        hessian = (design * (rows.weights * p * (1 - p))[:, None]).T @ design + 2 * prior * np.eye(2)
        step = np.zeros(2)
        step[free] = np.linalg.solve(hessian[np.ix_(free, free)], gradient[free])
        solution -= np.clip(step, -1.0, 1.0)
    return solution
