"""Projective matrices: from points in space to an image (section II.A), and cameras placed around the performer.

Space: metres, x to the performer's right, y up, z to the performer's back. Image: u to the right, v DOWN.
The position of a camera is a direction from the performer: yaw 0 is in front, yaw 90° at the right side, a positive
pitch is above, pitch 90° straight above. Cameras have no roll.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

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
