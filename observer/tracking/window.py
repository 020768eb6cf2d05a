"""Looking for skin in a piece of the picture: CAMshift from a window, and blobs."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from observer.tracking.patch import Patch
from observer.tracking.skin import Picture
from observer.tracks import Floats

STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 10, 0.5)
SKIN = 110
"""Back-projection, of 255, from which a pixel counts as skin in blobs."""
FILLED = 0.3
"""Less of a window than this in skin: the part is not there."""
LONGEST = 2.4
"""Skin longer than so many times its width (standard deviations) is no hand: an edge, a bare arm."""


@dataclass(frozen=True, slots=True)
class Region:
    """A rectangle of the picture, cut to it: pixels x0 ≤ u < x1, y0 ≤ v < y1."""

    x0: int
    y0: int
    x1: int
    y1: int

    @classmethod
    def around(cls, centre: Floats, half: tuple[float, float], shape: tuple[int, ...]) -> "Region":
        """`half` width and height about `centre`; at least one pixel, inside a picture of `shape`."""
        (height, width), (u, v) = shape[:2], (float(centre[0]), float(centre[1]))
        x0, y0 = int(min(max(u - half[0], 0), width - 1)), int(min(max(v - half[1], 0), height - 1))
        x1, y1 = int(min(max(u + half[0] + 1, x0 + 1), width)), int(min(max(v + half[1] + 1, y0 + 1), height))
        return cls(x0, y0, x1, y1)

    def cut(self, picture: Picture) -> Picture:
        """A view of this piece of the picture."""
        return picture[self.y0 : self.y1, self.x0 : self.x1]

    @property
    def origin(self) -> Floats:
        """(2,) px of the upper left corner."""
        return np.array([self.x0, self.y0], dtype=np.float64)


def camshift(back: Picture, start: Floats, side: float) -> Patch | None:
    """CAMshift on a back-projection (H, W) uint8 from a square window about `start` (2,), both in its own pixels.

    The window may grow to twice the area it had and not beyond: it would swallow a face beside a hand; then the fixed
    window of mean shift gives the centre. None where the window holds too little skin: lost, not at (0, 0).
    """
    first = _box(start, side, back.shape)
    if not cv2.countNonZero(back[first[1] : first[1] + first[3], first[0] : first[0] + first[2]]):
        first = _box(start, 2 * side, back.shape)
    _, box = cv2.CamShift(back, first, STOP)
    if box[2] < 1 or box[3] < 1 or box[2] * box[3] > 4 * side**2:
        _, box = cv2.meanShift(back, _box(start, 1.4 * side, back.shape), STOP)
    return _patch(back, tuple(box))


def _box(centre: Floats, side: float, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    region = Region.around(centre, (side / 2, side / 2), shape)
    return region.x0, region.y0, region.x1 - region.x0, region.y1 - region.y0


def _patch(back: Picture, box: tuple[int, ...]) -> Patch | None:
    x, y, w, h = box
    mass = cv2.moments(back[y : y + h, x : x + w])
    if mass["m00"] < FILLED * 255 * max(w * h, 1) or _long(mass):
        return None
    centre = np.array([x + mass["m10"] / mass["m00"], y + mass["m01"] / mass["m00"]])
    return Patch(centre, mass["m00"] / 255)


def blobs(back: Picture, smallest: float, largest: float) -> list[Patch]:
    """Connected pieces of skin with areas between the two (px²), largest first, in the pixels of `back`.

    The area is the back-projection's mass within the piece's upright box, in pixels, as CAMshift measures it.
    """
    mask = cv2.threshold(cv2.blur(back, (3, 3)), SKIN, 255, cv2.THRESH_BINARY)[1]
    found = []
    for outline in cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0]:
        x, y, w, h = cv2.boundingRect(outline)
        if w * h < smallest:
            continue
        mass = cv2.moments(back[y : y + h, x : x + w])
        area = mass["m00"] / 255
        if smallest <= area <= largest and not _long(mass):
            found.append(Patch(np.array([x + mass["m10"] / mass["m00"], y + mass["m01"] / mass["m00"]]), area))
    return sorted(found, key=lambda patch: -patch.area)


def _long(mass: Mapping[str, float]) -> bool:
    """Whether the longer axis of the skin's ellipse (square roots of the covariance's eigenvalues) is too long."""
    half, apart = (mass["mu20"] + mass["mu02"]) / 2, (mass["mu20"] - mass["mu02"]) / 2
    radius = math.hypot(apart, mass["mu11"])
    # A pixel's own extent, 1/12, keeps a row of single pixels from being infinitely long.
    return half + radius > LONGEST**2 * (max(half - radius, 0.0) + mass["m00"] / 12)


def erase(back: Picture, centre: Floats, half: tuple[float, float]) -> None:
    """Set the ellipse with half axes `half` about `centre` to 0 in place: there is another part."""
    axes = (max(round(half[0]), 1), max(round(half[1]), 1))
    cv2.ellipse(back, (round(float(centre[0])), round(float(centre[1]))), axes, 0, 0, 360, 0, -1)
