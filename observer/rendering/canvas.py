"""Drawing a figure's shapes into a picture with OpenCV: smooth edges, shaded as if round, the farthest first."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.rendering.body import HEAD
from observer.rendering.face import complexion
from observer.rendering.figure import Cloth, Shape, Skin
from observer.rendering.lens import NEAREST, Lens
from observer.rendering.look import Look
from observer.tracks import Floats

Picture = NDArray[np.uint8]

SUBPIXEL_BITS = 4
NOBODY = 255
CLOSEST_SKIN = 0.2
"""Metres: a part nearer than this fills the lens rather than being seen; it is not drawn."""
_CIRCLE = np.stack([np.cos(np.arange(16) * np.pi / 8), np.sin(np.arange(16) * np.pi / 8)], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Canvas:
    """A picture (H, W, 3) being drawn, and for each pixel the body part (H, W) that it shows, NOBODY for none."""

    picture: Picture
    owner: Picture


@dataclass(frozen=True, slots=True)
class Box:
    """The part of a picture from (left, top) up to but without (right, bottom)."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.bottom - self.top, self.right - self.left

    @property
    def window(self) -> tuple[slice, slice]:
        """The index of these pixels."""
        return slice(self.top, self.bottom), slice(self.left, self.right)


def draw(canvas: Canvas, lens: Lens, shapes: list[Shape], look: Look) -> None:
    """Draw the shapes, the farthest from the camera first: what is nearer covers what is behind it."""
    for shape in sorted(shapes, key=lambda s: -float(np.linalg.norm(s.place - lens.centre)) - s.bias):
        if isinstance(shape, Cloth):
            _draw_cloth(canvas, lens, shape)
        else:
            _draw_skin(canvas, lens, shape, look)


def _draw_cloth(canvas: Canvas, lens: Lens, cloth: Cloth) -> None:
    pixels, depth = lens.see(cloth.points)
    if depth.min() < NEAREST:
        return
    radii = cloth.radii * lens.focal_px / depth
    rims = (pixels[:, None] + radii[:, None, None] * _CIRCLE).reshape(-1, 2)
    box = _box(canvas, rims.min(axis=0), rims.max(axis=0))
    if box is None:
        return
    corners = (rims - (box.left, box.top)) * 2**SUBPIXEL_BITS
    outline = cv2.convexHull(np.rint(np.clip(corners, -(2**24), 2**24)).astype(np.int32))
    mask = np.zeros(box.shape, np.uint8)
    cv2.fillConvexPoly(mask, outline, 255, cv2.LINE_AA, SUBPIXEL_BITS)
    shade = _roundness(mask, float(radii.max()))
    colours = shade[..., None] * np.array(cloth.colour, np.float32)
    _blend(canvas, box, mask.astype(np.float32) / 255.0, colours, NOBODY)


def _roundness(mask: Picture, radius_px: float) -> NDArray[np.float32]:
    """Brightness as of something round that is lit from above: dark at its rim, darker still at its lower one."""
    # The rim of the patch is no rim of the shape, but cut off there: distances are to black pixels only.
    inside = cv2.distanceTransform((mask > 127).astype(np.uint8), cv2.DIST_L2, 5)
    depth = np.minimum(inside / max(radius_px, 1.0), 1.0)
    slope = cv2.Sobel(depth, cv2.CV_32F, 0, 1, ksize=3, scale=radius_px / 8.0)
    shade: NDArray[np.float32] = np.clip(0.62 + 0.42 * np.sqrt(depth) + 0.07 * slope, 0.4, 1.15).astype(np.float32)
    return shade


def _draw_skin(canvas: Canvas, lens: Lens, skin: Skin, look: Look) -> None:
    """An ellipsoid by its lines of sight: each meets it, on the ball that `Lens.conic` makes of it, at WBd + t Wv."""
    if lens.see(skin.place[None])[1][0] < CLOSEST_SKIN:
        return
    pixel, WB, Wv, conic = lens.conic(skin.place, skin.axes)
    a, cross = float(Wv @ Wv), WB.T @ Wv
    extent = np.linalg.inv(conic)
    reach = np.sqrt(np.diag(extent)) + 1.0
    box = _box(canvas, pixel - reach, pixel + reach)
    if box is None:
        return
    x = np.arange(box.left, box.right, dtype=np.float32) - np.float32(pixel[0])
    y = np.arange(box.top, box.bottom, dtype=np.float32)[:, None] - np.float32(pixel[1])
    outward = np.sqrt(conic[0, 0] * x * x + 2 * conic[0, 1] * x * y + conic[1, 1] * y * y)
    b = cross[0] * x + cross[1] * y
    along = -(b + np.sqrt(np.maximum(1.0 - outward**2, 0.0) * a)) / a
    surface = [(WB[i, 0] * x + WB[i, 1] * y + Wv[i] * along).astype(np.float32) for i in range(3)]
    alpha = np.clip((1.0 - outward) * np.sqrt(np.linalg.eigvalsh(extent)[0]) + 0.5, 0.0, 1.0).astype(np.float32)
    colours = complexion(surface, skin.axes, Wv, look, skin.part == HEAD)
    _blend(canvas, box, alpha, colours, skin.part)


def _blend(canvas: Canvas, box: Box, alpha: NDArray[np.float32], colours: NDArray[np.float32], part: int) -> None:
    window = canvas.picture[box.window]
    behind = window.astype(np.float32)
    window[:] = np.clip(behind + alpha[..., None] * (colours - behind) + 0.5, 0.0, 255.0).astype(np.uint8)
    canvas.owner[box.window][alpha > 0.5] = part


def _box(canvas: Canvas, low: Floats, high: Floats) -> Box | None:
    """The pixels between two corners as far as they are in the picture; None where none is."""
    rows, columns = canvas.owner.shape
    left, top = (max(0, int(np.floor(value)) - 1) for value in np.clip(low, -1e6, 1e6))
    right, bottom = (
        min(most, int(np.ceil(value)) + 2)
        for most, value in zip((columns, rows), np.clip(high, -1e6, 1e6), strict=True)
    )
    return Box(left, top, right, bottom) if left < right and top < bottom else None
