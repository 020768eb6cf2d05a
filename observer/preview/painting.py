"""Paints what an observer sees: its picture with marks, the panel beside it, the motion below."""

import cv2
import numpy as np

from common.errors import BadInput
from observer.preview.layout import CANVAS, SIZE, Box, Layout, Placement
from observer.preview.lettering import SMALL, write
from observer.preview.marks import draw_marks
from observer.preview.panel import draw_panel
from observer.preview.sight import Picture, Sight
from observer.preview.strip import draw_strip

EMPTY = 14
"""Grey level about the picture."""
LETTERS = (150, 150, 150)
FLOOR, GRID = 46, 58
"""Grey levels of the canvas that stands in for a picture."""


def paint(picture: Picture | None, sight: Sight) -> Picture:
    """(H, W, 3) BGR, or None for recorded motion without pictures -> (720, 1280, 3) BGR; the picture is not changed.

    Raises BadInput for what is no such picture.
    """
    layout = Layout.of(*CANVAS) if picture is None else Layout.of(*_size(picture))
    canvas = np.full((SIZE[1], SIZE[0], 3), EMPTY, np.uint8)
    place = layout.picture.cut(canvas)
    if picture is None:
        place[:] = canvas_for(layout.picture)
        placement = Placement.of_motion(sight.extent, layout.picture)
    else:
        place[:] = _resized(picture, layout.picture)
        placement = Placement.of_picture(picture.shape[1], layout.picture)
    draw_marks(place, placement, sight)
    draw_panel(layout.panel.cut(canvas), sight)
    draw_strip(layout.strip.cut(canvas), sight)
    return canvas


def canvas_for(box: Box) -> Picture:
    """What is painted where there is no picture: a dark sheet with squares, (height, width, 3) of the box."""
    sheet = np.full((box.height, box.width, 3), FLOOR, np.uint8)
    side = max(box.height // 12, 1)
    sheet[::side] = GRID
    sheet[:, ::side] = GRID
    write(sheet, "recorded motion, no picture", (12, box.height - 12), LETTERS, SMALL, width_px=box.width - 24)
    return sheet


def _size(picture: Picture) -> tuple[int, int]:
    if picture.ndim != 3 or picture.shape[2] != 3 or picture.dtype != np.uint8 or not picture.size:
        raise BadInput(
            f"picture {picture.shape} of {picture.dtype}: (H, W, 3) of uint8 in the order blue, green, red is expected"
        )
    return picture.shape[1], picture.shape[0]


def _resized(picture: Picture, box: Box) -> Picture:
    way = cv2.INTER_AREA if box.width < picture.shape[1] else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(picture, (box.width, box.height), interpolation=way), dtype=np.uint8)
