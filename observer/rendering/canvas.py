"""Draws a figure's shapes into a picture with OpenCV: smooth edges, shaded as if round, farthest first."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.geometry.projection import oriented
from observer.rendering.body import HEAD
from observer.rendering.figure import Appearance, ClothHull, Shape, SkinEllipsoid, complexion
from observer.tracks import Floats, Picture

NEAREST = 0.05
"""Least depth in metres of a point that can be drawn."""


class PinholeCamera:
    """A pinhole camera by its (3, 4) matrix from metres to pixels.

    With H scaled to |h3| = 1 (rows h1, h2, h3 of its left 3x3), w is the depth in metres and the focal lengths are
    |h1 × h3| and |h2 × h3| (Hartley and Zisserman, section 6.2); `focal_px` is their geometric mean. centre: (3,).
    Raises BadInput for a matrix that is parallel, singular or not (3, 4).
    """

    def __init__(self, matrix: Floats) -> None:
        if np.shape(matrix) != (3, 4):
            raise BadInput(f"projective matrix of shape {np.shape(matrix)}: (3, 4) is expected")
        H = oriented(matrix)
        left = H[:, :3]
        if not H[2, :3].any() or abs(np.linalg.det(left)) < 1e-18:
            raise BadInput("projective matrix: a pinhole camera is expected, not a parallel or singular projection")
        self._H = H = H / np.linalg.norm(H[2, :3])
        x, y, z = H[:, :3]
        self.focal_px = float(np.linalg.norm(np.cross(x, z)) * np.linalg.norm(np.cross(y, z))) ** 0.5
        self.centre: Floats = np.linalg.solve(H[:, :3], -H[:, 3]).astype(np.float64)

    def project(self, points: Floats) -> tuple[Floats, Floats]:
        """(K, 3) points -> (K, 2) pixels and (K,) depths in metres; pixels are invalid where depth < NEAREST."""
        image = points @ self._H[:, :3].T + self._H[:, 3]
        depth = image[:, 2]
        return image[:, :2] / np.maximum(depth, NEAREST)[:, None], depth

    def unproject_about(self, centre: Floats) -> tuple[Floats, Floats, Floats]:
        """At a point (3,): its pixel p (2,), the viewing direction v (3,), and B (3, 2).

        centre + B (q - p) is projected to the pixel q near p, and lies in the plane through the centre perpendicular to
        v: the inverse of the linearised projection.
        """
        image = self._H[:, :3] @ centre + self._H[:, 3]
        pixel = image[:2] / image[2]
        direction = centre - self.centre
        direction = direction / np.linalg.norm(direction)
        jacobian = (self._H[:2, :3] - np.outer(pixel, self._H[2, :3])) / image[2]
        B = np.linalg.inv(np.vstack([jacobian, direction]))[:, :2]
        return pixel, direction, B

    def conic(self, centre: Floats, axes: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Pixel p (2,), WB (3, 2), Wv (3,) and Q (2, 2) of an ellipsoid; the columns of `axes` are its semi-axes.

        W is the inverse of `axes`, p, B and v as `unproject_about` gives them. The ray through the pixel p + d
        meets the ellipsoid where d Q d <= 1, with Q = (WB)ᵀ(WB) - ggᵀ/|Wv|², g = (WB)ᵀ Wv.
        """
        pixel, direction, B = self.unproject_about(centre)
        W = np.linalg.inv(axes)
        WB, Wv = W @ B, W @ direction
        g = WB.T @ Wv
        return pixel, WB, Wv, WB.T @ WB - np.outer(g, g) / float(Wv @ Wv)


SUBPIXEL_BITS = 4
NOBODY_VALUE = 255
CLOSEST_SKIN = 0.2
"""Metres: a nearer part would fill the picture and is not drawn."""
_CIRCLE = np.stack([np.cos(np.arange(16) * np.pi / 8), np.sin(np.arange(16) * np.pi / 8)], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Canvas:
    """A picture (H, W, 3) being drawn, and the body part (H, W) that each pixel shows, NOBODY_VALUE for none."""

    picture: Picture
    owner: Picture


Window = tuple[slice, slice]
"""The rows and columns of a part of a picture."""


def draw(canvas: Canvas, camera: PinholeCamera, shapes: list[Shape], appearance: Appearance) -> None:
    """Draw the shapes, the farthest from the camera first (painter's algorithm)."""
    for shape in sorted(shapes, key=lambda s: -float(np.linalg.norm(s.centre - camera.centre)) - s.bias):
        if isinstance(shape, ClothHull):
            _draw_cloth(canvas, camera, shape)
        else:
            _draw_skin(canvas, camera, shape, appearance)


def _draw_cloth(canvas: Canvas, camera: PinholeCamera, cloth: ClothHull) -> None:
    pixels, depth = camera.project(cloth.points)
    if depth.min() < NEAREST:
        return
    radii = cloth.radii * camera.focal_px / depth
    rims = (pixels[:, None] + radii[:, None, None] * _CIRCLE).reshape(-1, 2)
    box = _box(canvas, rims.min(axis=0), rims.max(axis=0))
    if box is None:
        return
    rows, columns = box
    corners = (rims - (columns.start, rows.start)) * 2**SUBPIXEL_BITS
    outline = cv2.convexHull(np.rint(np.clip(corners, -(2**24), 2**24)).astype(np.int32))
    mask = np.zeros_like(canvas.owner[box])
    cv2.fillConvexPoly(mask, outline, 255, cv2.LINE_AA, SUBPIXEL_BITS)
    shade = _roundness(mask, float(radii.max()))
    colours = shade[..., None] * np.array(cloth.colour, np.float32)
    _blend(canvas, box, mask.astype(np.float32) / 255.0, colours, NOBODY_VALUE)


def _roundness(mask: Picture, radius_px: float) -> NDArray[np.float32]:
    """Brightness of a round shape lit from above: darker at the rim, darkest at the lower rim."""
    # The border of the mask is where the picture ends, not the shape: distances are to black pixels only.
    inside = cv2.distanceTransform((mask > 127).astype(np.uint8), cv2.DIST_L2, 5)
    depth = np.minimum(inside / max(radius_px, 1.0), 1.0)
    slope = cv2.Sobel(depth, cv2.CV_32F, 0, 1, ksize=3, scale=radius_px / 8.0)
    shade: NDArray[np.float32] = np.clip(0.62 + 0.42 * np.sqrt(depth) + 0.07 * slope, 0.4, 1.15).astype(np.float32)
    return shade


def _draw_skin(canvas: Canvas, camera: PinholeCamera, skin: SkinEllipsoid, appearance: Appearance) -> None:
    """Cast a ray through each pixel: on the unit ball of `PinholeCamera.conic` it is WBd + t Wv."""
    if camera.project(skin.centre[None])[1][0] < CLOSEST_SKIN:
        return
    pixel, WB, Wv, conic = camera.conic(skin.centre, skin.axes)
    a, cross = float(Wv @ Wv), WB.T @ Wv
    extent = np.linalg.inv(conic)
    reach = np.sqrt(np.diag(extent)) + 1.0
    box = _box(canvas, pixel - reach, pixel + reach)
    if box is None:
        return
    rows, columns = box
    x = np.arange(columns.start, columns.stop, dtype=np.float32) - np.float32(pixel[0])
    y = np.arange(rows.start, rows.stop, dtype=np.float32)[:, None] - np.float32(pixel[1])
    outward = np.sqrt(conic[0, 0] * x * x + 2 * conic[0, 1] * x * y + conic[1, 1] * y * y)
    b = cross[0] * x + cross[1] * y
    along = -(b + np.sqrt(np.maximum(1.0 - outward**2, 0.0) * a)) / a
    surface = [(WB[i, 0] * x + WB[i, 1] * y + Wv[i] * along).astype(np.float32) for i in range(3)]
    alpha = np.clip((1.0 - outward) * np.sqrt(np.linalg.eigvalsh(extent)[0]) + 0.5, 0.0, 1.0).astype(np.float32)
    colours = complexion(surface, skin.axes, Wv, appearance, skin.part == HEAD)
    _blend(canvas, box, alpha, colours, skin.part)


def _blend(canvas: Canvas, box: Window, alpha: NDArray[np.float32], colours: NDArray[np.float32], part: int) -> None:
    window = canvas.picture[box]
    behind = window.astype(np.float32)
    window[:] = np.clip(behind + alpha[..., None] * (colours - behind) + 0.5, 0.0, 255.0).astype(np.uint8)
    canvas.owner[box][alpha > 0.5] = part


def _box(canvas: Canvas, low: Floats, high: Floats) -> Window | None:
    """The pixels between two corners, clipped to the picture; None where there are none."""
    rows, columns = canvas.owner.shape
    left, top = (max(0, int(np.floor(value)) - 1) for value in np.clip(low, -1e6, 1e6))
    right, bottom = (
        min(most, int(np.ceil(value)) + 2)
        for most, value in zip((columns, rows), np.clip(high, -1e6, 1e6), strict=True)
    )
    return (slice(top, bottom), slice(left, right)) if left < right and top < bottom else None
