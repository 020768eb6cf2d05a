"""A calibrated camera in all its parts: lens, place, projective matrix, and what lens distortion does to pixels."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from common.errors import BadInput
from observer.geometry.lens import LensDistortion, distorted, undistorted
from observer.geometry.projection import Floats, project


@dataclass(frozen=True, slots=True, eq=False)
class CalibratedCamera:
    """One camera.

    K: (3, 3) intrinsic matrix, pixels. distortion: (4, 5, 8, 12 or 14) as
    OpenCV orders them, or (0,) where it is not known. R: (3, 3), t: (3,) metres,
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
    def lens(self) -> LensDistortion | None:
        """What its camera file says of the lens; None where its distortion is not known."""
        return LensDistortion(self.K, self.distortion) if len(self.distortion) else None

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

    def moved(self, R: Floats, t: Floats) -> "CalibratedCamera":
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
