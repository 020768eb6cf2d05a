"""Triangulation: one point in space from where several cameras see it, leaving out cameras that contradict the rest."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.geometry.projection import Floats, oriented, project

GATE_PX = 20.0
"""A camera that the point misses by more is left out: twice what trackers are off in pictures 1000 to 2000 px high."""

STEPS = 10
"""Gauss-Newton steps of the refinement; from the linear solution three are usual."""


@dataclass(frozen=True, slots=True, eq=False)
class TriangulatedPoint:
    """point: (3,) metres, NaN when no two cameras agree. used: (N,) the cameras it rests on.

    errors_px: (N,) distance of the projected point from what each camera saw; NaN where it saw nothing.
    """

    point: Floats
    used: NDArray[np.bool_]
    errors_px: Floats

    @property
    def error_px(self) -> float:
        """Root mean square over the cameras used; NaN when there is no point."""
        return float(np.sqrt(np.mean(self.errors_px[self.used] ** 2))) if self.used.any() else float("nan")


def triangulate(matrices: Sequence[Floats] | Floats, pixels: Floats, gate_px: float = GATE_PX) -> TriangulatedPoint:
    """(N, 3, 4) projective matrices, (N, 2) pixels (NaN row: not seen; undistorted) -> the point.

    Every two cameras that see it propose a point; the one that most cameras agree with to `gate_px` wins, the smaller
    error deciding a tie. From those cameras: linear solution (Hartley and Zisserman, section 12.2), then the least sum
    of squared reprojection errors by Gauss-Newton. With three cameras and one wrong it can be told which; with two that
    contradict each other there is no point. Raises BadInput for shapes that do not fit and a gate that is not positive.
    """
    Hs, pixels = np.asarray(matrices, dtype=np.float64), np.asarray(pixels, dtype=np.float64)
    if Hs.ndim != 3 or Hs.shape[1:] != (3, 4) or pixels.shape != (len(Hs), 2):
        raise BadInput(f"matrices {Hs.shape}, pixels {pixels.shape}: (N, 3, 4) and (N, 2) are needed, one row a camera")
    if not gate_px > 0:
        raise BadInput(f"gate_px = {gate_px:g}: a distance in pixels above 0, e.g. {GATE_PX:g}")
    Hs = np.array([oriented(H) for H in Hs])
    used = _agreeing(Hs, pixels, gate_px)
    if used.sum() < 2:
        nothing = np.full(len(Hs), np.nan)
        return TriangulatedPoint(np.full(3, np.nan), np.zeros(len(Hs), dtype=np.bool_), nothing)
    point = _refined(linear_point(Hs[used], pixels[used]), Hs[used], pixels[used])
    return TriangulatedPoint(point, used, _errors(Hs, pixels, point))


def linear_point(matrices: Floats, pixels: Floats) -> Floats:
    """(N, 3, 4), (N, 2), N at least 2, all finite -> (3,) the point with the least algebraic error; may be infinite.

    Two rows a camera: u h3·X = h1·X and v h3·X = h2·X; each scaled to length 1, so that no camera counts more for
    the unit that its matrix happens to be in.
    """
    rows = pixels[:, :, None] * matrices[:, 2:3] - matrices[:, :2]
    rows = rows / np.linalg.norm(rows[..., :3], axis=-1, keepdims=True)
    X = np.linalg.svd(rows.reshape(-1, 4))[2][-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        point: Floats = X[:3] / X[3]
    return point


def _agreeing(Hs: Floats, pixels: Floats, gate_px: float) -> NDArray[np.bool_]:
    """(N,) the largest set of cameras that one pair's point satisfies; all False when there is none."""
    best, least = np.zeros(len(Hs), dtype=np.bool_), np.inf
    seen = np.flatnonzero(np.isfinite(pixels).all(axis=1) & Hs.any(axis=(1, 2)))
    for pair in combinations(seen, 2):
        chosen = list(pair)
        errors = _errors(Hs, pixels, linear_point(Hs[chosen], pixels[chosen]))
        # NaN compares false: neither a blind camera nor one with the point behind it agrees.
        agree = errors <= gate_px
        if not agree[chosen].all():
            continue
        total = float((errors[agree] ** 2).mean())
        if (agree.sum(), -total) > (best.sum(), -least):
            best, least = agree, total
    return best


def _errors(Hs: Floats, pixels: Floats, point: Floats) -> Floats:
    """(N,) pixels; NaN where the camera saw nothing or the point is behind it."""
    return np.array([np.linalg.norm(project(H, point) - seen) for H, seen in zip(Hs, pixels, strict=True)])


def _refined(point: Floats, Hs: Floats, pixels: Floats) -> Floats:
    """(3,) the point after Gauss-Newton steps on the reprojection error, as long as each of them lowers it."""
    cost = _cost(point, Hs, pixels)
    for _ in range(STEPS):
        image = Hs[:, :, :3] @ point + Hs[:, :, 3]
        depth = image[:, 2:]
        slopes = (Hs[:, :2, :3] - (image[:, :2] / depth)[:, :, None] * Hs[:, 2:, :3]) / depth[:, :, None]
        away = (pixels - image[:, :2] / depth).ravel()
        moved = point + np.linalg.lstsq(slopes.reshape(-1, 3), away, rcond=None)[0]
        moved_cost = _cost(moved, Hs, pixels)
        if not moved_cost < cost:
            break
        point, cost = moved, moved_cost
    return point


def _cost(point: Floats, Hs: Floats, pixels: Floats) -> float:
    return float((_errors(Hs, pixels, point) ** 2).sum())
