"""Which measurement belongs to which part: the cheapest assignment, none beyond the gate."""

from collections.abc import Sequence
from itertools import product

import numpy as np

from observer.tracks import Floats

GATE = 13.8
"""Squared Mahalanobis distance that a part's own measurement stays under with probability 0.999 (chi², 2 degrees)."""


def squared_distances(predicted: Sequence[tuple[Floats, Floats]], measured: Floats) -> Floats:
    """(P, N) squared Mahalanobis distances of measurements (N, 2) from P predictions: centre (2,), spread (2, 2)."""
    rows = []
    for centre, spread in predicted:
        away = measured - centre
        rows.append(np.einsum("ni,ij,nj->n", away, np.linalg.inv(spread), away))
    return np.array(rows, dtype=np.float64).reshape(len(predicted), len(measured))


def assign(cost: Floats, gate: float) -> list[int | None]:
    """For each of P rows of cost (P, N) its column, or None; each column at most once.

    Minimises the sum of the costs where leaving a row without column costs `gate`; so no pair above the gate is ever
    made. Every assignment is looked at: two hands have few, and a solver for many would take more memory than all of
    the tracker.
    """
    within = [[None, *(column for column, c in enumerate(row) if c <= gate)] for row in cost.tolist()]

    def total(chosen: tuple[int | None, ...]) -> float:
        return sum(gate if column is None else float(cost[row, column]) for row, column in enumerate(chosen))

    cheapest = min((chosen for chosen in product(*within) if _each_once(chosen)), key=total)
    return list(cheapest)


def _each_once(columns: Sequence[int | None]) -> bool:
    taken = [column for column in columns if column is not None]
    return len(taken) == len(set(taken))
