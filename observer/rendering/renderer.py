"""Pictures of a performer as one camera sees him, and what in them is truly to be seen."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.rendering.body import Stature, pose, stature
from observer.rendering.canvas import NEAREST, NOBODY, Canvas, Picture, PinholeCamera, draw
from observer.rendering.figure import Appearance, SkinEllipsoid, appearance_of, shapes
from observer.rendering.scenery import Scenery, add_noise, background, occlude, relight
from observer.tracks import BODY_PARTS, Floats

SUB_FRAMES = 6
"""The most instants of an exposure that are averaged for motion blur, fewer where less than this is moved through:"""
BLUR_STEP_PX = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """What a picture shows. centres (P, 2): pixels, NaN where a part is not seen at all, for whatever reason.

    shares (P,): the visible share of each part's outline, 0 to 1: the rest is behind something or outside the
    picture. Of a head seen from behind or above the outline is seen though it is all hair.
    """

    centres: Floats
    shares: Floats

    def visible(self, share: float = 0.3) -> NDArray[np.bool_]:
        """(P,) whether at least that share of each part is seen."""
        enough: NDArray[np.bool_] = self.shares >= share
        return enough


class Renderer:
    """One camera's pictures of one performer: the same arguments give the same pictures, bit for bit on one machine.

    matrix: (3, 4) pinhole camera, metres to pixels. size_px: (width, height). seed: background, noise, light, and
    the performer's look where `look` is not given. standing: how the performer stands (body.stature of a
    recording); by default taken from each frame alone, which keeps a bending person standing.
    Raises BadInput for a matrix that is no pinhole camera, a size below 16 pixels, a negative seed.
    """

    def __init__(
        self,
        matrix: Floats,
        size_px: tuple[int, int] = (640, 480),
        scenery: Scenery | None = None,
        seed: int = 0,
        look: Appearance | None = None,
        standing: Stature | None = None,
    ) -> None:
        if min(size_px) < 16:
            raise BadInput(f"size_px = {size_px}: width and height of at least 16 pixels are expected")
        if seed < 0:
            raise BadInput(f"seed = {seed}: 0 or more is expected")
        self._lens = PinholeCamera.of(matrix)
        self._size_px = size_px
        self._scenery = scenery or Scenery()
        self._seed = seed
        self._look = look or appearance_of(seed)
        self._standing = standing

    def picture(self, positions: Floats, frame_number: int, before: Floats | None = None) -> Picture:
        """(P, 3) left hand, right hand, head in metres, NaN where not seen and not to be drawn -> (H, W, 3) BGR.

        before: the positions one frame earlier, which motion blur needs: the shutter is open for the last
        `scenery.blur` of the time since. Its cost is that of up to SUB_FRAMES figures.
        """
        instants = self._exposure(positions, before)
        canvas = self._drawn(instants[-1])
        if len(instants) > 1:
            total = canvas.picture.astype(np.uint16)
            for instant in instants[:-1]:
                total += self._drawn(instant).picture
            canvas = Canvas((total // len(instants)).astype(np.uint8), canvas.owner)
        occlude(canvas, self._scenery, frame_number)
        lit = relight(canvas.picture, self._scenery, self._seed, frame_number)
        return add_noise(lit, self._scenery, self._seed, frame_number)

    def visible_truth(self, positions: Floats, frame_number: int, before: Floats | None = None) -> Truth:
        """What `picture` shows of the parts; with motion blur, in the middle of the exposure."""
        instants = self._exposure(positions, before)
        middle = (instants[0] + instants[-1]) / 2
        canvas = self._drawn(middle)
        occlude(canvas, self._scenery, frame_number)
        parts = np.arange(len(BODY_PARTS))
        counts = np.bincount(canvas.owner.ravel(), minlength=NOBODY + 1)[parts]
        shares = np.minimum(counts / np.maximum(self._outline_areas(middle), 1.0), 1.0)
        pixels, depth = self._lens.see(np.nan_to_num(middle))
        seen = (counts > 0) & (depth > NEAREST)
        return Truth(np.where(seen[:, None], pixels, np.nan), np.where(seen, shares, 0.0))

    def _exposure(self, positions: Floats, before: Floats | None) -> list[Floats]:
        """The positions at the instants that a picture averages."""
        positions = np.asarray(positions, dtype=np.float64)
        if positions.shape != (len(BODY_PARTS), 3):
            raise BadInput(f"positions of shape {positions.shape}: ({len(BODY_PARTS)}, 3) is expected")
        if before is None or not self._scenery.blur:
            return [positions]
        # A part that was not seen before has not moved, as far as anybody knows.
        moved = np.where(np.isfinite(before), positions - before, 0.0) * self._scenery.blur
        _, depth = self._lens.see(np.nan_to_num(positions))
        furthest_px = np.nan_to_num(np.linalg.norm(moved, axis=1) * self._lens.focal_px / np.maximum(depth, 0.5)).max()
        steps = min(int(np.ceil(furthest_px / BLUR_STEP_PX)), SUB_FRAMES - 1)
        return [positions - moved * back for back in np.linspace(1.0, 0.0, steps + 1)] if steps else [positions]

    def _drawn(self, positions: Floats) -> Canvas:
        """The figure before its background, in steady light."""
        width, height = self._size_px
        scene = background(self._scenery.background, self._size_px, self._seed).copy()
        canvas = Canvas(scene, np.full((height, width), NOBODY, np.uint8))
        body = pose(positions, self._standing or stature(positions[None]))
        if body is not None:
            draw(canvas, self._lens, shapes(body, self._look), self._look)
        return canvas

    def _outline_areas(self, positions: Floats) -> Floats:
        """(P,) pixels that each part would cover if nothing hid it; 0 where it is not known or behind the camera."""
        areas = np.zeros(len(BODY_PARTS))
        body = pose(positions, self._standing or stature(positions[None]))
        for shape in shapes(body, self._look) if body is not None else ():
            if isinstance(shape, SkinEllipsoid):
                areas[shape.part] = self._lens.outline_area(shape.place, shape.axes)
        return areas
