"""What a pinhole camera's projective matrix says about distances and sizes in its picture; pure."""

from typing import Self

import numpy as np

from common.errors import BadInput
from observer.geometry.projection import Floats, oriented

NEAREST = 0.05
"""Metres before the camera: what is nearer cannot be drawn."""


class Lens:
    """A camera by its (3, 4) matrix, space in metres to picture in pixels."""

    __slots__ = ("_H", "centre", "focal_px")

    def __init__(self, H: Floats, centre: Floats, focal_px: float) -> None:
        self._H = H
        self.centre = centre
        self.focal_px = focal_px

    @classmethod
    def of(cls, matrix: Floats) -> Self:
        """The camera of a pinhole matrix. Raises BadInput for one that is parallel, singular or not (3, 4).

        With H scaled to |h3| = 1 (rows h1, h2, h3 of its left 3x3), w is the depth in metres and the focal lengths
        are |h1 × h3| and |h2 × h3| (Hartley and Zisserman, section 6.2); `focal_px` is their geometric mean.
        """
        if np.shape(matrix) != (3, 4):
            raise BadInput(f"projective matrix of shape {np.shape(matrix)}: (3, 4) is expected")
        H = oriented(matrix)
        left = H[:, :3]
        if not H[2, :3].any() or abs(np.linalg.det(left)) < 1e-18:
            raise BadInput("projective matrix: a pinhole camera is expected, not a parallel or singular projection")
        H = H / np.linalg.norm(H[2, :3])
        x, y, z = H[:, :3]
        focal = float(np.linalg.norm(np.cross(x, z)) * np.linalg.norm(np.cross(y, z))) ** 0.5
        centre: Floats = np.linalg.solve(H[:, :3], -H[:, 3]).astype(np.float64)
        return cls(H, centre, focal)

    def see(self, points: Floats) -> tuple[Floats, Floats]:
        """(K, 3) points -> (K, 2) pixels and (K,) depths in metres; pixels mean nothing where depth < NEAREST."""
        image = points @ self._H[:, :3].T + self._H[:, 3]
        depth = image[:, 2]
        return image[:, :2] / np.maximum(depth, NEAREST)[:, None], depth

    def unproject_about(self, centre: Floats) -> tuple[Floats, Floats, Floats]:
        """At a point (3,): its pixel p (2,), the line of sight v (3,), and B (3, 2).

        centre + B (q - p) is seen at the pixel q, near p, and lies in the plane through the centre that is
        perpendicular to v: the inverse of the projection's linear part.
        """
        image = self._H[:, :3] @ centre + self._H[:, 3]
        pixel = image[:2] / image[2]
        sight = centre - self.centre
        sight = sight / np.linalg.norm(sight)
        jacobian = (self._H[:2, :3] - np.outer(pixel, self._H[2, :3])) / image[2]
        B = np.linalg.inv(np.vstack([jacobian, sight]))[:, :2]
        return pixel, sight, B

    def conic(self, place: Floats, axes: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Pixel p (2,), WB (3, 2), Wv (3,) and Q (2, 2) of an ellipsoid at `place`, columns of `axes` its semi-axes.

        W is the inverse of `axes`, p, B and v as `unproject_about` gives them. The line of sight through the pixel
        p + d meets the ellipsoid where d Q d <= 1, with Q = (WB)ᵀ(WB) - ggᵀ/|Wv|², g = (WB)ᵀ Wv.
        """
        pixel, sight, B = self.unproject_about(place)
        W = np.linalg.inv(axes)
        WB, Wv = W @ B, W @ sight
        g = WB.T @ Wv
        return pixel, WB, Wv, WB.T @ WB - np.outer(g, g) / float(Wv @ Wv)

    def outline_area(self, place: Floats, axes: Floats) -> float:
        """Pixels inside the outline of that ellipsoid; 0 behind the camera."""
        if self.see(place[None])[1][0] < NEAREST:
            return 0.0
        return float(np.pi / np.sqrt(np.linalg.det(self.conic(place, axes)[3])))
