"""Triangulation: one point in space from several cameras, without those that disagree with the rest; pure."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.geometry.projection import Floats, oriented, project

GATE_PX = 20.0
"""Gate for the reprojection error of a camera: twice the error of trackers in pictures 1000 to 2000 px high."""
STEPS = 10
"""Most Gauss-Newton steps; three are usual from the linear solution."""


@dataclass(frozen=True, slots=True, eq=False)
class TriangulatedPoint:
    """point: (3,) metres, NaN when no two cameras agree. used: (N,) the inlier cameras.

    errors_px: (N,) reprojection error of each camera; NaN where it did not see the point.
    """

    point: Floats
    used: NDArray[np.bool_]
    errors_px: Floats

    @property
    def error_px(self) -> float:
        """Root mean square over the inliers; NaN without a point."""
        return float(np.sqrt(np.mean(self.errors_px[self.used] ** 2))) if self.used.any() else float("nan")


def triangulate(matrices: Sequence[Floats] | Floats, pixels: Floats, gate_px: float = GATE_PX) -> TriangulatedPoint:
    """(N, 3, 4) projective matrices, (N, 2) undistorted pixels (NaN row: not seen) -> the point.

    Every pair of cameras proposes a point; the proposal with most cameras within `gate_px` wins, the smaller error
    decides a tie. Its inliers give the linear solution (Hartley and Zisserman, section 12.2), refined by Gauss-Newton
    to the least squared reprojection error. Three cameras reveal one wrong camera; two that disagree give no point.
    Raises BadInput for shapes that do not match and for a gate that is not positive.
    """
    Hs, pixels = np.asarray(matrices, dtype=np.float64), np.asarray(pixels, dtype=np.float64)
    if Hs.ndim != 3 or Hs.shape[1:] != (3, 4) or pixels.shape != (len(Hs), 2):
        raise BadInput(
            f"matrices {Hs.shape}, pixels {pixels.shape}: (N, 3, 4) and (N, 2) are needed, one row per camera"
        )
    if not gate_px > 0:
        raise BadInput(f"gate_px = {gate_px:g}: a distance in pixels above 0, e.g. {GATE_PX:g}")
    Hs = np.array([oriented(H) for H in Hs])
    used = _inliers(Hs, pixels, gate_px)
    if used.sum() < 2:
        nothing = np.full(len(Hs), np.nan)
        return TriangulatedPoint(np.full(3, np.nan), np.zeros(len(Hs), dtype=np.bool_), nothing)
    point = _refined(linear_point(Hs[used], pixels[used]), Hs[used], pixels[used])
    return TriangulatedPoint(point, used, _errors(Hs, pixels, point))


def linear_point(matrices: Floats, pixels: Floats) -> Floats:
    """(N, 3, 4), (N, 2), N at least 2, all finite -> (3,) the point with the least algebraic error; may be infinite.

    Two rows per camera: u h3·X = h1·X and v h3·X = h2·X, each scaled to length 1, so that the scale of a matrix does
    not weight its camera.
    """
    rows = pixels[:, :, None] * matrices[:, 2:3] - matrices[:, :2]
    rows = rows / np.linalg.norm(rows[..., :3], axis=-1, keepdims=True)
    X = np.linalg.svd(rows.reshape(-1, 4))[2][-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        point: Floats = X[:3] / X[3]
    return point


def _inliers(Hs: Floats, pixels: Floats, gate_px: float) -> NDArray[np.bool_]:
    """(N,) the largest set of cameras that agree with the point of one pair; all False when there is none."""
    best, least = np.zeros(len(Hs), dtype=np.bool_), np.inf
    usable = np.flatnonzero(np.isfinite(pixels).all(axis=1) & Hs.any(axis=(1, 2)))
    for pair in combinations(usable, 2):
        chosen = list(pair)
        errors = _errors(Hs, pixels, linear_point(Hs[chosen], pixels[chosen]))
        # NaN compares false: a camera without the point, or with the point behind it, does not agree.
        agree = errors <= gate_px
        if not agree[chosen].all():
            continue
        total = float((errors[agree] ** 2).mean())
        if (agree.sum(), -total) > (best.sum(), -least):
            best, least = agree, total
    return best


def _errors(Hs: Floats, pixels: Floats, point: Floats) -> Floats:
    """(N,) px; NaN where the camera does not see the point or the point is behind it."""
    return np.array([np.linalg.norm(project(H, point) - pixel) for H, pixel in zip(Hs, pixels, strict=True)])


def _refined(point: Floats, Hs: Floats, pixels: Floats) -> Floats:
    """(3,) the point after Gauss-Newton steps on the reprojection error, while each step lowers it."""
    cost = _cost(point, Hs, pixels)
    for _ in range(STEPS):
        image = Hs[:, :, :3] @ point + Hs[:, :, 3]
        depth = image[:, 2:]
        slopes = (Hs[:, :2, :3] - (image[:, :2] / depth)[:, :, None] * Hs[:, 2:, :3]) / depth[:, :, None]
        residuals = (pixels - image[:, :2] / depth).ravel()
        moved = point + np.linalg.lstsq(slopes.reshape(-1, 3), residuals, rcond=None)[0]
        moved_cost = _cost(moved, Hs, pixels)
        if not moved_cost < cost:
            break
        point, cost = moved, moved_cost
    return point


def _cost(point: Floats, Hs: Floats, pixels: Floats) -> float:
    return float((_errors(Hs, pixels, point) ** 2).sum())
