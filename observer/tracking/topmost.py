"""A head without a face: the topmost patch of a known skin colour, for cameras at the side or behind."""

import cv2
import numpy as np

from observer.tracking.face import Box
from observer.tracking.skin import Picture, Skin
from observer.tracking.window import SKIN

LOOKED_AT = 240
"""Pictures are made so small, px of the shorter side."""
AREAS = (1 / 4000, 1 / 30)
"""Least and largest share of the picture that the skin of a head has."""
MOST_PATCHES = 6
"""With more patches than a head, two hands, a neck and feet show, the background has the colour of skin."""
ABOVE = 1.0
"""A second patch is at least so many widths of the head lower, or the topmost one may be a hand."""
FACE_PER_ROOT = {"towards": 1.15, "away": 2.2}
"""Width of a face per square root of its visible skin: as the cascade's boxes about it, on rendered people; of who
turns his back a cheek, an ear and the neck show."""


def topmost_skin(picture: Picture, skin: Skin, away: bool = False) -> Box | None:
    """(H, W, 3) BGR -> x, y, width, height px of a square about the head; None where none can be told.

    away: the person turns his back to the camera, and shows less skin of the head. Standing with the hands down, the
    topmost skin of a person is the head's. Nothing is told where the whole picture is full of such patches, or where
    two are equally high.
    """
    scale = max(1.0, min(picture.shape[:2]) / LOOKED_AT)
    size = (round(picture.shape[1] / scale), round(picture.shape[0] / scale))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    mask: Picture = (skin.back_project(small) >= SKIN).astype(np.uint8)
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    count, _, stats, centres = cv2.connectedComponentsWithStats(mask)
    areas = stats[1:count, cv2.CC_STAT_AREA] / mask.size
    large = [1 + int(i) for i in np.flatnonzero((areas >= AREAS[0]) & (areas <= AREAS[1]))]
    if not large or len(large) > MOST_PATCHES or (areas > AREAS[1]).any():
        return None
    large.sort(key=lambda label: float(centres[label][1]))
    width = FACE_PER_ROOT["away" if away else "towards"] * float(np.sqrt(stats[large[0], cv2.CC_STAT_AREA]))
    u, v = centres[large[0]]
    if len(large) > 1 and centres[large[1]][1] - v < ABOVE * width:
        return None
    x, y, side = (u - width / 2) * scale, (v - width / 2) * scale, width * scale
    return round(x), round(y), round(side), round(side)
