"""A calibrated camera: intrinsics, distortion, extrinsics and projective matrix; pure."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from common.errors import BadInput
from observer.geometry.projection import Floats, LensDistortion, distorted, project


@dataclass(frozen=True, slots=True, eq=False)
class CalibratedCamera:
    """One camera.

    K: (3, 3) intrinsic matrix, px. distortion: (4, 5 or 8) in OpenCV's order, or (0,) where unknown. R: (3, 3),
    t: (3,) metres: extrinsics, X_camera = R X_room + t. image_size_px: (width, height), where known. error_px: root
    mean square reprojection error, where known. provenance: how it was calibrated.
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
        """(3, 4) K [R | t]: metres to undistorted pixels; w is the depth in metres."""
        return self.K @ np.column_stack([self.R, self.t])

    @property
    def lens(self) -> LensDistortion | None:
        """The lens for the camera file; None where the distortion is unknown."""
        return LensDistortion(self.K, self.distortion) if len(self.distortion) else None

    @property
    def position(self) -> Floats:
        """(3,) position of the camera in the room, metres."""
        return -self.R.T @ self.t

    def pixels(self, points: Floats) -> Floats:
        """(..., 3) metres -> (..., 2) pixels with distortion; NaN for points behind the camera."""
        normalised = distorted(project(np.column_stack([self.R, self.t]), points), self.distortion)
        return normalised @ self.K[:2, :2].T + self.K[:2, 2]

    def moved(self, R: Floats, t: Floats) -> "CalibratedCamera":
        """The same camera in a room whose points are X' = R X + t."""
        R_new = self.R @ R.T
        return replace(self, R=R_new, t=self.t - R_new @ t)


def rotation(values: Sequence[object], what: str) -> Floats:
    """(3,) Rodrigues vector or (3, 3) matrix -> (3, 3) rotation; raises BadInput that starts with `what`."""
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.zeros(0)
    if array.shape == (3,) and np.isfinite(array).all():
        from scipy.spatial.transform import Rotation

        return np.asarray(Rotation.from_rotvec(array).as_matrix(), np.float64)
    if array.shape != (3, 3) or not np.allclose(array @ array.T, np.eye(3), atol=1e-3) or np.linalg.det(array) < 0:
        expected = "3 numbers (Rodrigues vector) or an orthogonal 3x3 matrix with determinant 1"
        raise BadInput(f"{what}: not a rotation; expected {expected}")
    left, _, right = np.linalg.svd(array)
    nearest: Floats = left @ right
    return nearest


def angle_between(first: Floats, second: Floats) -> float:
    """Angle between two (3, 3) rotations, 0 to π radians."""
    return float(np.arccos(np.clip((np.trace(first.T @ second) - 1) / 2, -1, 1)))
