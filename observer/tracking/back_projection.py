"""The skin back-projection of one picture, searched for body parts with CAMshift and connected components."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from observer.tracking.skin import Picture, SkinHistogram
from observer.tracks import Floats


@dataclass(frozen=True, slots=True)
class SkinPatch:
    """A piece of skin: centre (2,) px, area in px² of skin-coloured pixels, moved: share of it that moved, 0 to 1."""

    centre: Floats
    area: float
    moved: float = 0.0


STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 10, 0.5)
SKIN = 110
"""Back-projection, of 255, from which a pixel counts as skin in blobs."""
FILLED = 0.3
"""Less of a window than this in skin: the part is not there."""
LONGEST = 2.4
"""Skin longer than so many times its width (standard deviations) is no hand: an edge, a bare arm."""


@dataclass(frozen=True, slots=True)
class PixelRect:
    """A rectangle of the picture, cut to it: pixels x0 ≤ u < x1, y0 ≤ v < y1."""

    x0: int
    y0: int
    x1: int
    y1: int

    @classmethod
    def around(cls, centre: Floats, half: tuple[float, float], shape: tuple[int, ...]) -> "PixelRect":
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


def camshift(back: Picture, start: Floats, side: float) -> SkinPatch | None:
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
    region = PixelRect.around(centre, (side / 2, side / 2), shape)
    return region.x0, region.y0, region.x1 - region.x0, region.y1 - region.y0


def _patch(back: Picture, box: tuple[int, ...]) -> SkinPatch | None:
    x, y, w, h = box
    mass = cv2.moments(back[y : y + h, x : x + w])
    if mass["m00"] < FILLED * 255 * max(w * h, 1) or _long(mass):
        return None
    centre = np.array([x + mass["m10"] / mass["m00"], y + mass["m01"] / mass["m00"]])
    return SkinPatch(centre, mass["m00"] / 255)


def blobs(back: Picture, smallest: float, largest: float) -> list[SkinPatch]:
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
            found.append(SkinPatch(np.array([x + mass["m10"] / mass["m00"], y + mass["m01"] / mass["m00"]]), area))
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


FACE_PX = 20.0
"""Pictures are looked at in steps of so many pixels that a face is about as wide as this; a hand is half as wide."""
SKIN_TONED = 0.15
"""Share of the surroundings in skin colour that stands still, from which on only what is new counts."""
Mask = tuple[Floats, tuple[float, float]]
"""An ellipse not to be looked at: centre (2,) and half axes, px of the picture."""


def step_for(face: float) -> int:
    """Pixels of the picture to one of the retina, for a face so many px wide."""
    return max(1, round(face / FACE_PX))


def shrunk(picture: Picture, step: int) -> Picture:
    """The whole picture, one pixel for step x step."""
    if step == 1:
        return picture
    size = (max(picture.shape[1] // step, 1), max(picture.shape[0] // step, 1))
    return cv2.resize(picture, size, interpolation=cv2.INTER_LINEAR)


@dataclass(frozen=True, slots=True)
class BackProjection:
    """back, moved, fresh: (h, w) uint8 of the surroundings, 0 to 255; places and areas are in px of the whole picture.

    step: px of the picture to one of these; origin: (2,) of these, the corner. crowded: the surroundings are of skin
    colour, and `back` shows of them only what is fresh.
    """

    skin: Picture
    back: Picture
    moved: Picture
    step: int
    region: PixelRect

    @classmethod
    def of(
        cls, small: Picture, step: int, skin: SkinHistogram, masks: Sequence[Picture], region: PixelRect
    ) -> "BackProjection":
        """From a `shrunk` picture; masks: what moved, what is new, and what of the region is backdrop."""
        everything = skin.back_project(region.cut(small))
        moved, fresh, stale = region.cut(masks[0]), region.cut(masks[1]), masks[2]
        # Before a wall of skin colour a hand is known by being new there; elsewhere old skin is no hand.
        crowded = cv2.countNonZero(cv2.bitwise_and(stale, cv2.bitwise_not(fresh))) > SKIN_TONED * stale.size
        shown = fresh if crowded else cv2.bitwise_or(cv2.bitwise_not(stale), cv2.bitwise_or(fresh, moved))
        return cls(everything, cv2.bitwise_and(everything, shown), moved, step, region)

    def camshift(
        self, start: Floats, side: float, wide: float, masks: Sequence[Mask], head: bool = False
    ) -> SkinPatch | None:
        """CAMshift from a window of `side` about `start`, looking no further than `wide`."""
        place, half = self._inside(start), wide / self.step
        window = PixelRect.around(place, (half, half), self.back.shape)
        back = window.cut(self.skin if head else self.back).copy()
        for centre, axes in masks:
            erase(back, self._inside(centre) - window.origin, (axes[0] / self.step, axes[1] / self.step))
        found = camshift(back, place - window.origin, side / self.step)
        return None if found is None else self._outside(SkinPatch(found.centre + window.origin, found.area))

    def blobs(self, masks: Sequence[Mask], smallest: float, largest: float, backdrop: bool = False) -> list[SkinPatch]:
        """All pieces of skin with areas between the two, largest first; with what is backdrop, if asked."""
        back = (self.skin if backdrop else self.back).copy()
        for centre, axes in masks:
            erase(back, self._inside(centre), (axes[0] / self.step, axes[1] / self.step))
        return [self._outside(p) for p in blobs(back, smallest / self.step**2, largest / self.step**2)]

    def _inside(self, centre: Floats) -> Floats:
        inside: Floats = (centre + 0.5) / self.step - 0.5 - self.region.origin
        return inside

    def _outside(self, patch: SkinPatch) -> SkinPatch:
        half = float(np.sqrt(patch.area)) / 2
        window = PixelRect.around(patch.centre, (half, half), self.back.shape)
        size = (window.x1 - window.x0) * (window.y1 - window.y0)
        moved = cv2.countNonZero(window.cut(self.moved)) / size
        centre = (patch.centre + self.region.origin + 0.5) * self.step - 0.5
        return SkinPatch(centre, patch.area * self.step**2, moved)
