"""Which measurement belongs to which part: the cheapest assignment, none beyond the gate."""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

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
    made (Kuhn 1955, by scipy's linear_sum_assignment on the matrix with P columns of `gate` added).
    """
    parts, candidates = cost.shape
    padded = np.hstack([np.minimum(cost, gate * 1e3 + 1e3), np.full((parts, parts), gate)])
    rows, columns = linear_sum_assignment(padded)
    chosen: list[int | None] = [None] * parts
    for row, column in zip(rows, columns, strict=True):
        if column < candidates and cost[row, column] <= gate:
            chosen[row] = int(column)
    return chosen
