"""A camera's lens: where it draws what a pinhole would see elsewhere, and the way back; pure."""

from dataclasses import dataclass, field

import numpy as np

from common.errors import BadInput
from observer.geometry.projection import Floats

DISTORTION_SIZES = (4, 5, 8, 12, 14)
"""k1 k2 p1 p2; with k3; with k4 k5 k6 (rational); with s1 to s4 (thin prism); with the tilts of the sensor."""

STEPS = 20
"""Newton steps back; five are usual, more only where the lens hardly moves the point on."""

MET_PX = 1e-3
"""A place that the way back misses by more is drawn by no point: it lies beyond where the lens folds over."""

MET = 1e-10
"""Normalised coordinates: nearer than any pixel can tell; the steps end here."""

STRIDE = 1e-6
"""Normalised coordinates: between rounding and the lens's curvature, for slopes by difference."""


@dataclass(frozen=True, slots=True, eq=False)
class LensDistortion:
    """A lens as OpenCV describes it.

    intrinsic_matrix: (3, 3) [[fu, s, cu], [0, fv, cv], [0, 0, 1]] px. distortion: (4, 5, 8, 12 or 14) in OpenCV's
    order. Raises BadInput for what is neither.
    """

    intrinsic_matrix: Floats
    distortion: Floats
    _inverse: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_intrinsic_matrix(self.intrinsic_matrix)
        if self.distortion.shape not in [(size,) for size in DISTORTION_SIZES]:
            raise BadInput(f"distortion: {self.distortion.size} numbers; OpenCV has {SIZES_SAID}")
        if not np.isfinite(self.distortion).all():
            raise BadInput("distortion: a number is not finite; calibrate again")
        object.__setattr__(self, "_inverse", np.linalg.inv(self.intrinsic_matrix[:2, :2]))

    def undistorted(self, centres: Floats) -> Floats:
        """(..., 2) px of the picture -> (..., 2) px of the same intrinsic matrix without distortion.

        NaN stays NaN; NaN too for a place in which the lens draws nothing.
        """
        K = self.intrinsic_matrix
        plain = undistorted((centres - K[:2, 2]) @ self._inverse.T, self.distortion)
        return self._pixels(plain)

    def distorted(self, centres: Floats) -> Floats:
        """(..., 2) px without distortion -> (..., 2) px of the picture: the inverse of `undistorted`."""
        K = self.intrinsic_matrix
        return self._pixels(distorted((centres - K[:2, 2]) @ self._inverse.T, self.distortion))

    def _pixels(self, normalised: Floats) -> Floats:
        result: Floats = normalised @ self.intrinsic_matrix[:2, :2].T + self.intrinsic_matrix[:2, 2]
        return result


SIZES_SAID = "4 (k1 k2 p1 p2), 5 (and k3), 8, 12 or 14"


def check_intrinsic_matrix(K: Floats) -> None:
    """Raise BadInput unless K is (3, 3) [[fu, s, cu], [0, fv, cv], [0, 0, 1]], finite, with fu and fv above 0."""
    right = K.shape == (3, 3) and np.isfinite(K).all() and np.allclose(K[2], [0, 0, 1])
    if not (right and K[0, 0] > 0 and K[1, 1] > 0 and K[1, 0] == 0):
        raise BadInput("no intrinsic matrix [[fu, s, cu], [0, fv, cv], [0, 0, 1]] with fu, fv above 0")


def distorted(plain: Floats, distortion: Floats) -> Floats:
    """(..., 2) normalised coordinates -> (..., 2) where the lens draws them; distortion: of any known size, or none.

    Brown-Conrady, rational, thin prism and tilted sensor, as OpenCV's calib3d defines them.
    """
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tilt_x, tilt_y = _whole(distortion)
    x, y = plain[..., 0], plain[..., 1]
    r2 = x * x + y * y
    factor = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    u = x * factor + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + r2 * (s1 + r2 * s2)
    v = y * factor + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + r2 * (s3 + r2 * s4)
    drawn = np.stack([u, v], axis=-1)
    return _tilted(drawn, tilt_x, tilt_y) if tilt_x or tilt_y else drawn


def undistorted(drawn: Floats, distortion: Floats, focal_px: float = 1000.0) -> Floats:
    """(..., 2) normalised coordinates as drawn -> (..., 2) without distortion, by Newton's method; the inverse.

    Begun at the drawn place, it comes to the nearest point that the lens draws there. NaN where there is none to
    MET_PX at this focal length.
    """
    if not distortion.any():
        return drawn
    plain = drawn
    # The place itself and its neighbours in one call: an observer does this in every frame.
    around = STRIDE * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1.0]]).reshape(5, *[1] * (drawn.ndim - 1), 2)
    with np.errstate(all="ignore"):
        for _ in range(STEPS):
            here, right, left, down, up = distorted(plain + around, distortion)
            off = here - drawn
            if not (np.abs(off) > MET).any():
                break
            plain = plain - _solved((right - left) / (2 * STRIDE), (down - up) / (2 * STRIDE), off)
        missed = np.linalg.norm(distorted(plain, distortion) - drawn, axis=-1, keepdims=True) * focal_px
    return np.where(missed <= MET_PX, plain, np.nan)


def _solved(a: Floats, b: Floats, c: Floats) -> Floats:
    """x, y with a x + b y = c, each (..., 2), by Cramer's rule."""
    across = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    x = c[..., 0] * b[..., 1] - c[..., 1] * b[..., 0]
    y = a[..., 0] * c[..., 1] - a[..., 1] * c[..., 0]
    result: Floats = np.stack([x, y], axis=-1) / across[..., None]
    return result


def _whole(distortion: Floats) -> list[float]:
    """All 14 numbers, those that are not given 0."""
    return [*distortion.tolist(), *[0.0] * (14 - len(distortion))]


def _tilted(drawn: Floats, tilt_x: float, tilt_y: float) -> Floats:
    """(..., 2) on a sensor turned by these angles (rad) about its axes (OpenCV, Scheimpflug)."""
    cos_x, sin_x, cos_y, sin_y = np.cos(tilt_x), np.sin(tilt_x), np.cos(tilt_y), np.sin(tilt_y)
    about_x = np.array([[1, 0, 0], [0, cos_x, sin_x], [0, -sin_x, cos_x]])
    about_y = np.array([[cos_y, 0, -sin_y], [0, 1, 0], [sin_y, 0, cos_y]])
    R = about_y @ about_x
    H = np.array([[R[2, 2], 0, -R[0, 2]], [0, R[2, 2], -R[1, 2]], [0, 0, 1]]) @ R
    image = drawn @ H[:, :2].T + H[:, 2]
    result: Floats = image[..., :2] / image[..., 2:]
    return result
