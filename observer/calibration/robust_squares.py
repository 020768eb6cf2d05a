"""Least robust squares of a large sparse problem, by Levenberg's and Marquardt's steps; pure."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

from observer.calibration.bundle_layout import Blocks
from observer.geometry.projection import Floats

if TYPE_CHECKING:
    from scipy.sparse import csr_array

ROUNDS = 60
"""Steps at most; ten are usual."""

ENOUGH = 1e-7
"""A step that lowers the cost by a smaller share of it is the last."""

HOPELESS = 1e9
"""With so much damping a step is too small to matter."""


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """x: (U,) the unknowns. residuals: (R,) there. cost: sum of soft squares."""

    x: Floats
    residuals: Floats
    cost: float


def least_robust_squares(evaluate: Callable[[Floats], tuple[Floats, Blocks]], start: Floats, soft: float) -> Solved:
    """x near `start` with the least sum of soft²(√(1 + (r/soft)²) - 1): r²/2 for small r, soft·|r| for large.

    evaluate: x -> residuals (R,), any unit, and their slopes. Each step solves the normal equations weighted by
    1/√(1 + (r/soft)²) (Triggs et al. 2000, section 4.3), damped until it lowers the cost.
    """
    x, damping = start, 1e-3
    residuals, blocks = evaluate(x)
    cost = _cost(residuals, soft)
    for _ in range(ROUNDS):
        weights = 1 / np.sqrt(1 + (residuals / soft) ** 2)
        slopes = blocks.matrix()
        normal = cast("csr_array[np.float64]", slopes.T @ (slopes * weights[:, None]))
        downhill = cast("Floats", slopes.T @ (-weights * residuals))
        while damping < HOPELESS:
            tried = x + _step(normal, downhill, damping)
            new_residuals, new_blocks = evaluate(tried)
            new_cost = _cost(new_residuals, soft)
            if new_cost <= cost:
                break
            damping *= 4
        else:
            break
        gain, x, residuals, blocks, cost = cost - new_cost, tried, new_residuals, new_blocks, new_cost
        damping = max(damping / 5, 1e-9)
        if gain <= ENOUGH * cost:
            break
    return Solved(x, residuals, cost)


def _step(normal: "csr_array[np.float64]", downhill: Floats, damping: float) -> Floats:
    from scipy.sparse import csc_array, diags_array
    from scipy.sparse.linalg import spsolve

    # An unknown that nothing depends on stays: its row would be all zero.
    scale = np.maximum(normal.diagonal(), 1e-12)
    step: Floats = spsolve(csc_array(normal + diags_array(damping * scale)), downhill)
    return step


def _cost(residuals: Floats, soft: float) -> float:
    cost = soft**2 * (np.sqrt(1 + (residuals / soft) ** 2) - 1)
    return float(cost.sum()) if np.isfinite(cost).all() else float("inf")
