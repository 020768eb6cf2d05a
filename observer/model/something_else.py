"""How likely something else is: its log odds are scaled by what people who were left out show. Pure.

A penalised regression is too cautious about people whom it has not learned from. Platt, "Probabilistic outputs for
support vector machines", Advances in Large Margin Classifiers, 1999.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from observer.model.parameters import POSITIVE, Parameter, ParameterRange
from observer.tracks import Floats

SLOPE, OFFSET = "else_slope", "else_offset"
SCALING: Mapping[str, Parameter] = {  # Learned in cross-validation.
    SLOPE: Parameter(1.0, POSITIVE),
    OFFSET: Parameter(0.0, ParameterRange(-20.0, 20.0)),
}
PRIOR = 10.0
"""Nats for a slope or an offset that is 1 away from its default: with few examples both stay near it."""
STEPS = 30


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
    # Earlier files lack the parameters.
    slope, offset = (parameters.get(name, parameter.default) for name, parameter in SCALING.items())
    odds = slope * float(log_odds_of(log_answers[None])[0]) + offset
    return 1.0 / (1.0 + math.exp(-min(max(odds, -40.0), 40.0)))


def learn_scaling(
    rows: Sequence[ElseRows], parameters: Mapping[str, float], explicit: Collection[str]
) -> dict[str, float]:
    """The slope and the offset of least log loss, by Newton's method; explicit ones stay as they are."""
    odds, targets, weights = (
        np.concatenate([[], *(getattr(r, name) for r in rows)]) for name in ("log_odds", "targets", "weights")
    )
    names = (SLOPE, OFFSET)
    start = np.array([parameters[name] for name in names])
    free = np.array([name not in explicit for name in names])
    design, solution = np.stack([odds, np.ones(len(odds))], axis=1), start.copy()
    for _ in range(STEPS):
        p = 1.0 / (1.0 + np.exp(-np.clip(design @ solution, -40, 40)))
        gradient = design.T @ (weights * (p - targets)) + 2 * PRIOR * (solution - start)
        hessian = (design * (weights * p * (1 - p))[:, None]).T @ design + 2 * PRIOR * np.eye(2)
        step = np.zeros(2)
        step[free] = np.linalg.solve(hessian[np.ix_(free, free)], gradient[free])
        solution -= np.clip(step, -1.0, 1.0)
    return dict(zip(names, np.clip(solution, (0.2, -5.0), (5.0, 5.0)).tolist(), strict=True))
