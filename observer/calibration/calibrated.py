"""A calibrated camera in all its parts: lens, place, projective matrix, and what lens distortion does to pixels."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from common.errors import BadInput
from observer.geometry.projection import Floats, project

DISTORTION_SIZES = (0, 4, 5, 8)
"""None; k1 k2 p1 p2; with k3; with k4 k5 k6 (OpenCV's rational model)."""

UNDISTORTING_STEPS = 30
"""Fixed-point steps; each shrinks the error by the distortion's slope, below 0.5 for every lens that boards show."""


@dataclass(frozen=True, slots=True, eq=False)
class Calibrated:
    """One camera.

    K: (3, 3) intrinsic matrix, pixels. distortion: (0, 4, 5 or 8) as OpenCV orders them. R: (3, 3), t: (3,) metres,
    from the room to the camera, X_camera = R X + t. error_px: root mean square over the calibration's points, where
    known. image_size_px: (width, height), where known. provenance: how it was calibrated.
    """

    name: str
    K: Floats
    distortion: Floats
    R: Floats
    t: Floats
    image_size_px: tuple[int, int] | None = None
    error_px: float | None = None
    provenance: str = ""

    @property
    def matrix(self) -> Floats:
        """(3, 4) K [R | t]: metres to pixels of the picture without distortion, w is the depth in metres."""
        result: Floats = self.K @ np.column_stack([self.R, self.t])
        return result

    @property
    def place(self) -> Floats:
        """(3,) where the camera stands in the room, metres."""
        result: Floats = -self.R.T @ self.t
        return result

    def pixels(self, points: Floats) -> Floats:
        """(..., 3) metres -> (..., 2) pixels as the lens draws them; NaN for what is behind the camera."""
        plain = project(np.column_stack([self.R, self.t]), points)
        return _to_pixels(self.K, distorted(plain, self.distortion))

    def undistorted(self, pixels: Floats) -> Floats:
        """(..., 2) pixels of the picture -> (..., 2) pixels in which `matrix` holds; NaN stays NaN."""
        plain = undistorted(_from_pixels(self.K, pixels), self.distortion)
        return _to_pixels(self.K, plain)

    def moved(self, R: Floats, t: Floats) -> "Calibrated":
        """The same camera when the room's points become X' = R X + t."""
        R_new = self.R @ R.T
        return replace(self, R=R_new, t=self.t - R_new @ t)


def rotation(values: Sequence[object], what: str) -> Floats:
    """(3,) Rodrigues vector or (3, 3) matrix -> (3, 3) rotation; raises BadInput beginning with `what`."""
    try:
        given = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        given = np.zeros(0)
    if given.shape == (3,) and np.isfinite(given).all():
        return _from_rodrigues(given)
    if given.shape != (3, 3) or not np.allclose(given @ given.T, np.eye(3), atol=1e-3) or np.linalg.det(given) < 0:
        raise BadInput(f"{what}: no rotation; 3 numbers (Rodrigues) or an orthogonal 3x3 matrix with determinant 1")
    left, _, right = np.linalg.svd(given)
    nearest: Floats = left @ right
    return nearest


def angle_between(first: Floats, second: Floats) -> float:
    """Radians by which one (3, 3) rotation is turned from the other, 0 to π."""
    return float(np.arccos(np.clip((np.trace(first.T @ second) - 1) / 2, -1, 1)))


def distorted(plain: Floats, distortion: Floats) -> Floats:
    """(..., 2) normalised coordinates -> (..., 2) where the lens draws them (Brown-Conrady, as OpenCV defines it)."""
    if not distortion.any():
        return plain
    factor, tangential = _distortion_at(plain, distortion)
    result: Floats = plain * factor + tangential
    return result


def undistorted(drawn: Floats, distortion: Floats) -> Floats:
    """(..., 2) normalised coordinates as drawn -> (..., 2) without distortion, by fixed-point iteration."""
    plain = drawn
    if distortion.any():
        for _ in range(UNDISTORTING_STEPS):
            factor, tangential = _distortion_at(plain, distortion)
            plain = (drawn - tangential) / factor
    return plain


def _distortion_at(plain: Floats, distortion: Floats) -> tuple[Floats, Floats]:
    k1, k2, p1, p2, k3, k4, k5, k6 = np.concatenate([distortion, np.zeros(8 - len(distortion))])
    x, y = plain[..., :1], plain[..., 1:]
    r2 = x * x + y * y
    factor = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    u = 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return factor, np.concatenate([u, v], axis=-1)


def _to_pixels(K: Floats, normalised: Floats) -> Floats:
    result: Floats = normalised @ K[:2, :2].T + K[:2, 2]
    return result


def _from_pixels(K: Floats, pixels: Floats) -> Floats:
    result: Floats = (pixels - K[:2, 2]) @ np.linalg.inv(K[:2, :2]).T
    return result


def _from_rodrigues(vector: Floats) -> Floats:
    angle = float(np.linalg.norm(vector))
    if angle == 0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    result: Floats = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)
    return result
