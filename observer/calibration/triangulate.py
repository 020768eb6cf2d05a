"""Triangulation: points in space from several cameras, without those that disagree with the rest; pure."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.geometry.projection import oriented, project
from observer.tracks import Floats

GATE_PX = 20.0
"""Gate for the reprojection error of a camera: twice the error of trackers in pictures 1000 to 2000 px high."""
MOST_GAUSS_NEWTON_STEPS = 10
"""Most Gauss-Newton steps; three are usual from the linear solution."""


@dataclass(frozen=True, slots=True, eq=False)
class TriangulatedPoints:
    """points: (M, 3) metres, NaN when no two cameras agree. used: (M, N) the inlier cameras.

    errors_px: (M, N) reprojection error of each camera; NaN where it did not see the point, or without a point.
    """

    points: Floats
    used: NDArray[np.bool_]
    errors_px: Floats


def triangulate_all(
    matrices: Sequence[Floats] | Floats, pixels: Floats, gate_px: float = GATE_PX
) -> TriangulatedPoints:
    """(N, 3, 4) projective matrices, (M, N, 2) undistorted pixels (NaN: not seen) -> M points.

    Every pair of cameras proposes a point; the proposal with most cameras within `gate_px` wins, the smaller error
    decides a tie. Its inliers give the linear solution (Hartley and Zisserman, section 12.2), refined by Gauss-Newton
    to the least squared reprojection error. Three cameras reveal one wrong camera; two that disagree give no point.
    Raises BadInput for shapes that do not match and for a gate that is not positive.
    """
    Hs, pixels = np.asarray(matrices, dtype=np.float64), np.asarray(pixels, dtype=np.float64)
    if Hs.ndim != 3 or Hs.shape[1:] != (3, 4) or pixels.ndim != 3 or pixels.shape[1:] != (len(Hs), 2):
        raise BadInput(
            f"matrices {Hs.shape}, pixels {pixels.shape}: (N, 3, 4) and (M, N, 2) are needed, one row per camera"
        )
    if not gate_px > 0:
        raise BadInput(f"gate_px = {gate_px:g}: a distance in pixels above 0, e.g. {GATE_PX:g}")
    Hs = np.array([oriented(H) for H in Hs])
    used = _inliers(Hs, pixels, gate_px)
    known = used.sum(axis=1) >= 2
    used[~known] = False
    points = np.full((len(pixels), 3), np.nan)
    if known.any():
        points[known] = _refined(_linear_points(Hs, pixels[known], used[known]), Hs, pixels[known], used[known])
    return TriangulatedPoints(points, used, _errors(Hs, pixels, points))


def _linear_points(Hs: Floats, pixels: Floats, used: NDArray[np.bool_]) -> Floats:
    """(N, 3, 4), (M, N, 2), (M, N) -> (M, 3) the points with the least algebraic error in the cameras `used`.

    Two rows per camera: u h3·X = h1·X and v h3·X = h2·X, each scaled to length 1, so that the scale of a matrix does
    not weight its camera. A point may be infinite.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        rows = pixels[..., None] * Hs[:, 2:3] - Hs[:, :2]
        rows = np.where(used[..., None, None], rows / np.linalg.norm(rows[..., :3], axis=-1, keepdims=True), 0.0)
        X = np.linalg.svd(rows.reshape(len(pixels), -1, 4), full_matrices=False)[2][:, -1]
        points: Floats = X[:, :3] / X[:, 3:]
    return points


def _inliers(Hs: Floats, pixels: Floats, gate_px: float) -> NDArray[np.bool_]:
    """(M, N) the largest set of cameras that agree with the point of one pair; all False where there is none."""
    best, least = np.zeros(pixels.shape[:2], dtype=np.bool_), np.full(len(pixels), np.inf)
    usable = np.isfinite(pixels[..., 0] + pixels[..., 1]) & np.array([H.any() for H in Hs], dtype=np.bool_)
    for pair in map(list, combinations(range(len(Hs)), 2)):
        rows = np.flatnonzero(usable[:, pair[0]] & usable[:, pair[1]])
        if not len(rows):
            continue
        used = np.zeros((len(rows), len(Hs)), dtype=np.bool_)
        used[:, pair] = True
        errors = _errors(Hs, pixels[rows], _linear_points(Hs, pixels[rows], used))
        # NaN compares false: a camera without the point, or with the point behind it, does not agree.
        agree = errors <= gate_px
        count = agree.sum(axis=1)
        total = np.where(agree, errors**2, 0.0).sum(axis=1) / np.maximum(count, 1)
        fewer, as_many = best[rows].sum(axis=1) < count, best[rows].sum(axis=1) == count
        better = agree[:, pair[0]] & agree[:, pair[1]] & (fewer | (as_many & (total < least[rows])))
        best[rows[better]], least[rows[better]] = agree[better], total[better]
    return best


def _errors(Hs: Floats, pixels: Floats, points: Floats) -> Floats:
    """(M, N) px; NaN where the camera does not see the point or the point is behind it."""
    errors: Floats = np.linalg.norm(np.stack([project(H, points) for H in Hs], axis=1) - pixels, axis=-1)
    return errors


def _refined(points: Floats, Hs: Floats, pixels: Floats, used: NDArray[np.bool_]) -> Floats:
    """(M, 3) the points after Gauss-Newton steps on the reprojection error, each while its steps lower it."""
    points, cost = points.copy(), _cost(points, Hs, pixels, used)
    active = np.arange(len(points))
    for _ in range(MOST_GAUSS_NEWTON_STEPS):
        moved = points[active] + _step(points[active], Hs, pixels[active], used[active])
        moved_cost = _cost(moved, Hs, pixels[active], used[active])
        lower = moved_cost < cost[active]
        active = active[lower]
        if not len(active):
            break
        points[active], cost[active] = moved[lower], moved_cost[lower]
    return points


def _step(points: Floats, Hs: Floats, pixels: Floats, used: NDArray[np.bool_]) -> Floats:
    """(M, 3) the Gauss-Newton step of each point."""
    image = np.einsum("nij,mj->mni", Hs[:, :, :3], points) + Hs[:, :, 3]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        depth = image[..., 2:]
        slopes = (Hs[:, :2, :3] - (image[..., :2] / depth)[..., None] * Hs[:, 2:, :3]) / depth[..., None]
        residuals = pixels - image[..., :2] / depth
    slopes, residuals = np.where(used[..., None, None], slopes, 0.0), np.where(used[..., None], residuals, 0.0)
    finite = np.isfinite(slopes).all(axis=(1, 2, 3)) & np.isfinite(residuals).all(axis=(1, 2))
    step = np.full(points.shape, np.nan)
    rows = slopes[finite].reshape(int(finite.sum()), -1, 3)
    step[finite] = np.einsum("mij,mj->mi", np.linalg.pinv(rows), residuals[finite].reshape(len(rows), -1))
    return step


def _cost(points: Floats, Hs: Floats, pixels: Floats, used: NDArray[np.bool_]) -> Floats:
    """(M,) sum of the squared errors of the cameras `used`; NaN where one does not see the point."""
    cost: Floats = np.where(used, _errors(Hs, pixels, points) ** 2, 0.0).sum(axis=1)
    return cost
