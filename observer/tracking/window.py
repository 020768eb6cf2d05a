"""Looking for skin in a piece of the picture: CAMshift from a window, and blobs."""

from dataclasses import dataclass

import cv2
import numpy as np

from observer.tracking.patch import Patch
from observer.tracking.skin import Picture
from observer.tracks import Floats

STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 10, 1.0)
SKIN = 110
"""Back-projection, of 255, from which a pixel counts as skin in blobs."""
FILLED = 0.3
"""Less of a window than this in skin: the part is not there."""


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
        height, width = shape[:2]
        x0, y0 = (int(np.clip(centre[k] - half[k], 0, (width, height)[k] - 1)) for k in (0, 1))
        x1, y1 = (int(np.clip(centre[k] + half[k] + 1, (x0, y0)[k] + 1, (width, height)[k])) for k in (0, 1))
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
    if not cv2.countNonZero(Region(first[0], first[1], first[0] + first[2], first[1] + first[3]).cut(back)):
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
    inside = back[y : y + h, x : x + w]
    mass = cv2.moments(inside)
    if mass["m00"] < FILLED * 255 * max(w * h, 1):
        return None
    centre = np.array([x + mass["m10"] / mass["m00"], y + mass["m01"] / mass["m00"]])
    return Patch(centre, mass["m00"] / 255)


def blobs(back: Picture, moved: Picture, smallest: float, largest: float) -> list[Patch]:
    """Connected pieces of skin with areas between the two (px²), largest first, in the pixels of `back`."""
    mask = cv2.morphologyEx((back >= SKIN).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    count, labels, stats, centres = cv2.connectedComponentsWithStats(cv2.dilate(mask, np.ones((3, 3), np.uint8)))
    found = []
    for label in range(1, count):
        x, y, w, h, area = (int(n) for n in stats[label])
        if smallest <= area <= largest and max(w, h) < 3.5 * min(w, h):
            piece = labels[y : y + h, x : x + w] == label
            share = float((moved[y : y + h, x : x + w][piece] > 0).mean())
            found.append(Patch(np.asarray(centres[label], dtype=np.float64), float(area), share))
    return sorted(found, key=lambda patch: -patch.area)


def erase(back: Picture, centre: Floats, half: tuple[float, float]) -> None:
    """Set the ellipse with half axes `half` about `centre` to 0 in place: there is another part."""
    axes = (max(round(half[0]), 1), max(round(half[1]), 1))
    cv2.ellipse(back, (round(float(centre[0])), round(float(centre[1]))), axes, 0, 0, 360, 0, -1)
