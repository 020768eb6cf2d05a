"""Robust sparse least squares (Levenberg-Marquardt), and the layout of the bundle adjustment's unknowns; pure."""

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from observer.tracks import Floats

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Integers = NDArray[np.intp]

POSE, LENS, BACK = 6, 5, 4
"""Number of unknowns of a pose (rotation vector, translation), a lens (f, cu, cv, k1, k2) and the board's back."""


class ParameterLayout:
    """Slices of the vector of unknowns, in this order: cameras, boards, lenses, time offsets, back.

    cameras, lenses: by camera; boards: by the number of the picture. size: number of unknowns.
    """

    def __init__(self, cameras: Iterable[str], boards: Iterable[int], lenses: Iterable[str], detections: int) -> None:
        self.size = 0
        self.cameras = {name: self._next(POSE) for name in cameras}
        self.boards = {number: self._next(POSE) for number in boards}
        self.lenses = {name: self._next(LENS) for name in lenses}
        self.time_offsets, self.back = self._next(detections), self._next(BACK)

    def _next(self, width: int) -> slice:
        self.size += width
        return slice(self.size - width, self.size)


class SparseJacobian:
    """A sparse Jacobian, filled block by block from the top. columns: number of unknowns."""

    def __init__(self, columns: int) -> None:
        self._columns, self._top, self._bottom = columns, 0, 0
        self._parts: list[tuple[Integers, Integers, Floats]] = []

    def begin(self, rows: int) -> None:
        """Start the next block of `rows` rows."""
        self._top, self._bottom = self._bottom, self._bottom + rows

    def add(self, columns: slice, slopes: Floats) -> None:
        """Add (rows, width) derivatives by these unknowns."""
        rows, across = np.mgrid[self._top : self._bottom, columns.start : columns.stop]
        self._parts.append((rows.ravel(), across.ravel(), slopes.ravel()))

    def add_diagonal(self, columns: Integers, slopes: Floats) -> None:
        """Add one row for each of these unknowns."""
        self.begin(len(columns))
        self._parts.append((np.arange(self._top, self._bottom), columns, slopes))

    def matrix(self) -> "csr_array[np.float64]":
        """The scipy.sparse matrix (rows, unknowns)."""
        from scipy.sparse import csr_array

        rows, columns, values = (np.concatenate(part) for part in zip(*self._parts, strict=True))
        return csr_array((values, (rows, columns)), shape=(self._bottom, self._columns))


MOST_STEPS = 60
"""Most steps; ten are usual."""
ENOUGH = 1e-7
"""The last step lowers the cost by a smaller share than this."""
HOPELESS = 1e9
"""Damping from which a step is too small to matter."""


def least_robust_squares(
    evaluate: Callable[[Floats], tuple[Floats, SparseJacobian]], start: Floats, soft: float
) -> tuple[Floats, Floats]:
    """Minimise the sum of soft²(√(1 + (r/soft)²) - 1) from `start`: r²/2 for small r, soft·|r| for large.

    Returns the unknowns (U,) and the residuals (R,) at the minimum. evaluate: x -> residuals, any unit, and their
    Jacobian. Each step solves the normal equations weighted by 1/√(1 + (r/soft)²) (Triggs et al. 2000, section 4.3),
    with the damping raised until the cost falls.
    """
    x, damping = start, 1e-3
    residuals, blocks = evaluate(x)
    cost = _cost(residuals, soft)
    for _ in range(MOST_STEPS):
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
    return x, residuals


def _step(normal: "csr_array[np.float64]", downhill: Floats, damping: float) -> Floats:
    from scipy.sparse import csc_array, diags_array
    from scipy.sparse.linalg import spsolve

    # Keeps unknowns without influence in place: their rows would be zero.
    scale = np.maximum(normal.diagonal(), 1e-12)
    return spsolve(csc_array(normal + diags_array(damping * scale)), downhill)


def _cost(residuals: Floats, soft: float) -> float:
    cost = soft**2 * (np.sqrt(1 + (residuals / soft) ** 2) - 1)
    return float(cost.sum()) if np.isfinite(cost).all() else float("inf")
