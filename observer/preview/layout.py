"""Where everything goes on a painted picture of 1280x720, and how places in the source become places on it. Pure."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from observer.preview.sight import Picture
from observer.tracks import Floats

SIZE = (1280, 720)
"""Width and height of every painted picture, px, so that a video of them may be one."""
STRIP = 116
"""Height of the strip of Vector Symbols, px."""
PANEL = (320, 560)
"""Least and greatest width of the panel beside the picture, px."""
CANVAS = (640, 480)
"""Width and height of the picture that stands in for recorded motion, px."""


@dataclass(frozen=True, slots=True)
class Box:
    """A rectangle of the painted picture, px."""

    x: int
    y: int
    width: int
    height: int

    def cut(self, canvas: Picture) -> Picture:
        """That part of the canvas; what is drawn on it is drawn on the canvas, and never beyond the box."""
        return canvas[self.y : self.y + self.height, self.x : self.x + self.width]


@dataclass(frozen=True, slots=True)
class Layout:
    """picture: the source's picture, in its own proportions. panel: right of it. strip: below both."""

    picture: Box
    panel: Box
    strip: Box

    @classmethod
    def of(cls, width_px: int, height_px: int) -> Self:
        """For a source of that size, which is 1 px or more each way."""
        room, height = SIZE[0] - PANEL[0], SIZE[1] - STRIP
        scale = min(room / width_px, height / height_px)
        wide, high = (max(1, round(n * scale)) for n in (width_px, height_px))
        panel = min(max(SIZE[0] - wide, PANEL[0]), PANEL[1])
        left = (SIZE[0] - panel - wide) // 2
        return cls(
            Box(left, (height - high) // 2, wide, high),
            Box(SIZE[0] - panel, 0, panel, height),
            Box(0, height, SIZE[0], STRIP),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """Source to box: scale times a place, plus shift (2,) px."""

    scale: float
    shift: Floats

    @classmethod
    def of_picture(cls, width_px: int, box: Box) -> Self:
        """A picture so wide, resized into the box; places are middles of pixels."""
        scale = box.width / width_px
        return cls(scale, np.full(2, 0.5 * scale - 0.5))

    @classmethod
    def of_motion(cls, extent: Floats | None, box: Box) -> Self:
        """(2, 2) corners of all motion so far, in any unit, into the middle of the box."""
        if extent is None:
            return cls(1.0, np.zeros(2))
        size = np.array([box.width, box.height], dtype=np.float64)
        sides = np.maximum(extent[1] - extent[0], 1e-9)
        scale = float((size / sides).min())
        return cls(scale, size / 2 - scale * extent.mean(axis=0))

    def px(self, places: Floats) -> Floats:
        """(..., 2) places of the source -> (..., 2) px in the box; NaN stays NaN."""
        return places * self.scale + self.shift
