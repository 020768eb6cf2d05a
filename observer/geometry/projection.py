"""Cameras: projection of points in space (section II.A), placement around the performer, lens distortion; pure.

Space: metres, x to the performer's right, y up, z to the performer's back. Image: u to the right, v DOWN.
The position of a camera is a direction from the performer: yaw 0 is in front, yaw 90° at the right side, a positive
pitch is above, pitch 90° straight above. Cameras have no roll.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from common.text import plural
from observer.tracks import Floats

ROUNDING = 1e-12
"""A depth below this share of its terms is rounding error: the point is in the camera plane."""


def project(matrix: Floats, points: NDArray[np.floating]) -> Floats:
    """(3, 4), (..., 3) -> (..., 2) image coordinates by I^T = H O^T (section II.A).

    A row is NaN where the point is not finite, or lies in or behind the camera plane. `matrix` may have any scale but
    zero: a point is in front where the third homogeneous coordinate w times the sign of det(left 3x3 of H) is positive,
    which holds for every camera with u right, v down and right-handed axes (Hartley and Zisserman, section 6.2.3). A
    parallel matrix, last row (0, 0, 0, w), has no camera plane and nothing behind it. Any other matrix with a singular
    left 3x3 is not a camera: NaN everywhere.
    """
    H = oriented(matrix)
    known = np.where(np.isfinite(points).all(axis=-1, keepdims=True), points, 0.0)
    image = known @ H[:, :3].T + H[:, 3]
    depth = image[..., 2:]
    # By lengths, not term by term: a coordinate that is only rounding error must not raise the limit.
    terms = np.linalg.norm(known, axis=-1, keepdims=True) * np.linalg.norm(H[2, :3]) + np.abs(H[2, 3])
    visible = np.isfinite(points).all(axis=-1, keepdims=True) & (depth > ROUNDING * terms)
    return np.where(visible, image[..., :2] / np.where(visible, depth, 1.0), np.nan)


def oriented(matrix: Floats) -> Floats:
    """(3, 4) -> (3, 4) the same projection, scaled so that w is positive exactly in front of the camera.

    The largest entry becomes 1 or -1; all entries are 0 when the matrix is not a camera.
    """
    largest = np.abs(matrix).max()
    if not (np.isfinite(largest) and largest > 0):
        return np.zeros((3, 4))
    H = matrix / largest
    parallel = not H[2, :3].any()
    side = np.sign(H[2, 3] if parallel else np.linalg.det(H[:, :3]))
    result: Floats = H * side
    return result


def picture_right(matrix: Floats) -> Floats:
    """(3, 4) projective matrix -> (3,) unit vector in space along the picture's right.

    The first row of the matrix, made orthogonal to the optical axis, the third row; a parallel matrix has no axis.
    """
    right, axis = oriented(matrix)[[0, 2], :3]
    if axis.any():
        right = right - axis * (right @ axis) / (axis @ axis)
    unit: Floats = right / np.linalg.norm(right)
    return unit


def parallel_matrix(yaw_rad: float, pitch_rad: float) -> Floats:
    """(3, 4) parallel projection in metres from that direction; the origin is projected to (0, 0)."""
    right, down, _ = _axes(yaw_rad, pitch_rad)
    return np.array([[*right, 0.0], [*down, 0.0], [0.0, 0.0, 0.0, 1.0]])


def pinhole_matrix(
    yaw_rad: float,
    pitch_rad: float,
    distance: float,
    focal_px: float,
    centre_px: Sequence[float],
    target: Sequence[float] = (0.0, 0.0, 0.0),
) -> Floats:
    """(3, 4) camera `distance` metres from `target` in that direction, looking at it: w is the depth in metres.

    focal_px: image length of 1 m at a distance of 1 m. centre_px: (u, v) of the target.
    """
    rotation = _axes(yaw_rad, pitch_rad)
    camera = np.asarray(target) - distance * rotation[2]
    intrinsic = np.array([[focal_px, 0.0, centre_px[0]], [0.0, focal_px, centre_px[1]], [0.0, 0.0, 1.0]])
    result: Floats = intrinsic @ np.column_stack([rotation, -rotation @ camera])
    return result


def _axes(yaw_rad: float, pitch_rad: float) -> Floats:
    """(3, 3) rows: image right, image down, viewing direction; right = viewing × up, down = viewing × right."""
    sin_yaw, cos_yaw = math.sin(yaw_rad), math.cos(yaw_rad)
    sin_pitch, cos_pitch = math.sin(pitch_rad), math.cos(pitch_rad)
    right = [-cos_yaw, 0.0, -sin_yaw]
    down = [sin_yaw * sin_pitch, -cos_pitch, -cos_yaw * sin_pitch]
    viewing = [-sin_yaw * cos_pitch, -sin_pitch, cos_yaw * cos_pitch]
    return np.array([right, down, viewing])


DISTORTION_SIZES = (4, 5, 8)
"""k1 k2 p1 p2; plus k3; plus k4 k5 k6 (rational)."""
DISTORTION_SIZES_TEXT = "4 (k1 k2 p1 p2), 5 (plus k3) or 8 (plus k4 k5 k6) numbers in the order of OpenCV"

MOST_NEWTON_STEPS = 20
"""Most Newton steps; five are usual, more are needed near the fold of the lens."""
TOLERANCE = 1e-6
"""Largest residual of a solution, normalised coordinates, a thousandth of a pixel at a focal length of 1000 px; a pixel
with a larger one is the image of no point, beyond the fold of the lens."""
CONVERGED = 1e-10
"""Residual at which the steps end, normalised coordinates: far below a pixel."""
FINITE_STEP = 1e-6
"""Step of the difference quotients, normalised coordinates: between rounding and the curvature of the lens."""


@dataclass(frozen=True, slots=True, eq=False)
class LensDistortion:
    """Intrinsics and distortion of a lens in OpenCV's model.

    intrinsic_matrix: (3, 3) [[fu, s, cu], [0, fv, cv], [0, 0, 1]] px. distortion: (4, 5 or 8) in OpenCV's order. Raises
    BadInput for other shapes and values.
    """

    intrinsic_matrix: Floats
    distortion: Floats
    _inverse: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_intrinsic_matrix(self.intrinsic_matrix)
        if self.distortion.shape not in [(size,) for size in DISTORTION_SIZES]:
            raise BadInput(f"distortion: {plural(self.distortion.size, 'number')}; expected {DISTORTION_SIZES_TEXT}")
        if not np.isfinite(self.distortion).all():
            raise BadInput("distortion: a number is not finite; calibrate again")
        object.__setattr__(self, "_inverse", np.linalg.inv(self.intrinsic_matrix[:2, :2]))

    def undistorted(self, centres: Floats) -> Floats:
        """(..., 2) px of the picture -> (..., 2) undistorted px of the same intrinsic matrix.

        NaN stays NaN, and pixels that are the image of no point become NaN.
        """
        K = self.intrinsic_matrix
        points = undistorted((centres - K[:2, 2]) @ self._inverse.T, self.distortion)
        return self._pixels(points)

    def distorted(self, centres: Floats) -> Floats:
        """(..., 2) undistorted px -> (..., 2) px of the picture: the inverse of `undistorted`."""
        K = self.intrinsic_matrix
        return self._pixels(distorted((centres - K[:2, 2]) @ self._inverse.T, self.distortion))

    def _pixels(self, normalised: Floats) -> Floats:
        return normalised @ self.intrinsic_matrix[:2, :2].T + self.intrinsic_matrix[:2, 2]


def check_intrinsic_matrix(K: Floats, where: str = "") -> None:
    """Raise BadInput unless K is (3, 3) [[fu, s, cu], [0, fv, cv], [0, 0, 1]], finite, with fu and fv above 0."""
    right = K.shape == (3, 3) and np.isfinite(K).all() and np.allclose(K[2], [0, 0, 1])
    if not (right and K[0, 0] > 0 and K[1, 1] > 0 and K[1, 0] == 0):
        raise BadInput(f"{where}not an intrinsic matrix [[fu, s, cu], [0, fv, cv], [0, 0, 1]] with fu, fv above 0")


def distorted(points: Floats, distortion: Floats) -> Floats:
    """(..., 2) normalised coordinates -> (..., 2) distorted ones; distortion: of any known size, or empty.

    Brown-Conrady and rational models as defined by OpenCV's calib3d.
    """
    k1, k2, p1, p2, k3, k4, k5, k6 = np.pad(distortion, (0, 8 - len(distortion)))
    x, y = points[..., 0], points[..., 1]
    r2 = x * x + y * y
    factor = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    u = x * factor + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * factor + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.stack([u, v], axis=-1)


def undistorted(distorted_points: Floats, distortion: Floats) -> Floats:
    """(..., 2) distorted normalised coordinates -> (..., 2) undistorted ones, by Newton's method: the inverse.

    Started at the distorted point, it converges to the nearest solution. NaN where no solution is within TOLERANCE.
    """
    if not distortion.any():
        return distorted_points
    points = distorted_points
    # The point and its four neighbours in one call: an observer does this in every frame.
    around = FINITE_STEP * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1.0]]).reshape(
        5, *[1] * (distorted_points.ndim - 1), 2
    )
    with np.errstate(all="ignore"):
        for _ in range(MOST_NEWTON_STEPS):
            centre, right, left, down, up = distorted(points + around, distortion)
            residual = centre - distorted_points
            if not (np.abs(residual) > CONVERGED).any():
                break
            points = points - _solved((right - left) / (2 * FINITE_STEP), (down - up) / (2 * FINITE_STEP), residual)
        residual = np.linalg.norm(distorted(points, distortion) - distorted_points, axis=-1, keepdims=True)
    return np.where(residual <= TOLERANCE, points, np.nan)


def _solved(a: Floats, b: Floats, c: Floats) -> Floats:
    """x, y with a x + b y = c, each (..., 2), by Cramer's rule."""
    across = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    x = c[..., 0] * b[..., 1] - c[..., 1] * b[..., 0]
    y = a[..., 0] * c[..., 1] - a[..., 1] * c[..., 0]
    return np.stack([x, y], axis=-1) / across[..., None]
