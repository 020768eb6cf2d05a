"""The skin back-projection, searched for body parts; and foreground and background of a stream of pictures."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from observer.tracking.skin import Picture, SkinHistogram, SkinPatch
from observer.tracks import Floats

STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 10, 0.5)
SKIN = 110
"""Back-projection (0 to 255) from which a pixel counts as skin in `blobs`."""
FILLED = 0.3
"""A window with a smaller share of skin than this does not hold the part."""
LONGEST = 2.4
"""Skin longer than this many times its width (in standard deviations) is an edge or a bare arm, not a hand."""


@dataclass(frozen=True, slots=True)
class PixelRect:
    """A rectangle inside a picture: pixels x0 ≤ u < x1, y0 ≤ v < y1."""

    x0: int
    y0: int
    x1: int
    y1: int

    @classmethod
    def around(cls, centre: Floats, half: tuple[float, float], shape: tuple[int, ...]) -> "PixelRect":
        """Half width and height `half` about `centre`, clipped to a picture of `shape`; at least one pixel."""
        (height, width), (u, v) = shape[:2], (float(centre[0]), float(centre[1]))
        x0, y0 = int(min(max(u - half[0], 0), width - 1)), int(min(max(v - half[1], 0), height - 1))
        x1, y1 = int(min(max(u + half[0] + 1, x0 + 1), width)), int(min(max(v + half[1] + 1, y0 + 1), height))
        return cls(x0, y0, x1, y1)

    def cut(self, picture: Picture) -> Picture:
        """A view of this part of the picture."""
        return picture[self.y0 : self.y1, self.x0 : self.x1]

    @property
    def origin(self) -> Floats:
        """(2,) px of the upper left corner."""
        return np.array([self.x0, self.y0], dtype=np.float64)


def camshift(back: Picture, start: Floats, side: float) -> SkinPatch | None:
    """CAMshift (Bradski 1998) on a back-projection (H, W) uint8, from a square window about `start` (2,), both in px.

    A window that grows beyond twice its side would swallow a face beside a hand; then mean shift with a fixed window
    gives the centre. None when the final window holds too little skin.
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
    """Connected pieces of skin with areas from `smallest` to `largest` (px²), largest first, in the pixels of `back`.

    The area is the mass of the back-projection in the bounding box, in pixels, as CAMshift measures it.
    """
    mask = cv2.threshold(cv2.blur(back, (3, 3)), SKIN, 255, cv2.THRESH_BINARY)[1]
    patches = []
    for outline in cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0]:
        x, y, w, h = cv2.boundingRect(outline)
        if w * h < smallest:
            continue
        mass = cv2.moments(back[y : y + h, x : x + w])
        area = mass["m00"] / 255
        if smallest <= area <= largest and not _long(mass):
            patches.append(SkinPatch(np.array([x + mass["m10"] / mass["m00"], y + mass["m01"] / mass["m00"]]), area))
    return sorted(patches, key=lambda patch: -patch.area)


def _long(mass: Mapping[str, float]) -> bool:
    """Whether the longer axis of the skin's ellipse (roots of the covariance's eigenvalues) is too long for a hand."""
    half, difference = (mass["mu20"] + mass["mu02"]) / 2, (mass["mu20"] - mass["mu02"]) / 2
    radius = math.hypot(difference, mass["mu11"])
    # A pixel's own extent, 1/12, keeps a row of single pixels from being infinitely long.
    return half + radius > LONGEST**2 * (max(half - radius, 0.0) + mass["m00"] / 12)


def erase(back: Picture, centre: Floats, half: tuple[float, float]) -> None:
    """Set the ellipse with half axes `half` about `centre` to 0, in place: another part is there."""
    axes = (max(round(half[0]), 1), max(round(half[1]), 1))
    cv2.ellipse(back, (round(float(centre[0])), round(float(centre[1]))), axes, 0, 0, 360, 0, -1)


FACE_PX = 20.0
"""Pictures are reduced so that a face is about this wide; a hand is half as wide."""
SKIN_TONED = 0.15
"""Share of still, skin-coloured surroundings from which on only pixels that differ from the background count."""
Mask = tuple[Floats, tuple[float, float]]
"""An ellipse to ignore: centre (2,) and half axes, px of the picture."""


def step_for(face: float) -> int:
    """Pixels of the picture per pixel of the back-projection, for a face `face` px wide."""
    return max(1, round(face / FACE_PX))


def shrunk(picture: Picture, step: int) -> Picture:
    """The whole picture, reduced by `step` each way."""
    if step == 1:
        return picture
    size = (max(picture.shape[1] // step, 1), max(picture.shape[0] // step, 1))
    return cv2.resize(picture, size, interpolation=cv2.INTER_LINEAR)


@dataclass(frozen=True, slots=True)
class BackProjection:
    """The back-projection of the person's surroundings; the methods take and return px of the whole picture.

    skin: (h, w) uint8, 0 to 255, all skin colour. back: the part of it that may be a hand. moved: (h, w) what moved.
    step: px of the picture per pixel here. region: where these pixels lie in the reduced picture.
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
        """From a `shrunk` picture. masks: what moved, what differs from the background, which skin is background."""
        everything = skin.back_project(region.cut(small))
        moved, foreground, background = region.cut(masks[0]), region.cut(masks[1]), masks[2]
        # In front of a skin-coloured wall only foreground can be a hand; elsewhere background skin cannot.
        still = cv2.countNonZero(cv2.bitwise_and(background, cv2.bitwise_not(foreground)))
        crowded = still > SKIN_TONED * background.size
        anything = cv2.bitwise_or(cv2.bitwise_not(background), cv2.bitwise_or(foreground, moved))
        return cls(everything, cv2.bitwise_and(everything, foreground if crowded else anything), moved, step, region)

    def camshift(
        self, start: Floats, side: float, wide: float, masks: Sequence[Mask], head: bool = False
    ) -> SkinPatch | None:
        """CAMshift from a window of `side` about `start`, within `wide` of it, px; None if nothing is there.

        masks: ellipses (centre, half axes) that are left out. head: search all skin colour.
        """
        position, half = self._inside(start), wide / self.step
        window = PixelRect.around(position, (half, half), self.back.shape)
        back = window.cut(self.skin if head else self.back).copy()
        for centre, axes in masks:
            erase(back, self._inside(centre) - window.origin, (axes[0] / self.step, axes[1] / self.step))
        patch = camshift(back, position - window.origin, side / self.step)
        return None if patch is None else self._outside(SkinPatch(patch.centre + window.origin, patch.area))

    def blobs(
        self, masks: Sequence[Mask], smallest: float, largest: float, include_background: bool = False
    ) -> list[SkinPatch]:
        """All patches with areas from `smallest` to `largest`, largest first; background skin only if asked."""
        back = (self.skin if include_background else self.back).copy()
        for centre, axes in masks:
            erase(back, self._inside(centre), (axes[0] / self.step, axes[1] / self.step))
        return [self._outside(p) for p in blobs(back, smallest / self.step**2, largest / self.step**2)]

    def _inside(self, centre: Floats) -> Floats:
        return (centre + 0.5) / self.step - 0.5 - self.region.origin

    def _outside(self, patch: SkinPatch) -> SkinPatch:
        half = float(np.sqrt(patch.area)) / 2
        window = PixelRect.around(patch.centre, (half, half), self.back.shape)
        size = (window.x1 - window.x0) * (window.y1 - window.y0)
        moved = cv2.countNonZero(window.cut(self.moved)) / size
        centre = (patch.centre + self.region.origin + 0.5) * self.step - 0.5
        return SkinPatch(centre, patch.area * self.step**2, moved)


RISE_S, FALL_S = 1.0, 1.0
"""Time constants with which a pixel becomes background while it shows skin of no body part, and stops being so."""
HALF = 0.2
"""Share of time from which a skin-coloured pixel counts as background."""


class SkinBackground:
    """For each pixel of a reduced picture, the share of time (0 to 255) for which it has shown skin of no body part.

    Shelves, doors and walls become background; a resting hand does not.
    """

    def __init__(self) -> None:
        self._share: Picture | None = None
        self._first = True

    def mask(self, region: PixelRect, shape: tuple[int, ...]) -> Picture:
        """(h, w) uint8 of the region, 255 where skin is background; another `shape` of the picture starts over."""
        if self._share is None or self._share.shape != shape[:2]:
            self._share, self._first = np.zeros(shape[:2], np.float32), True
        return (region.cut(self._share) > HALF * 255).astype(np.uint8) * 255

    def learn(self, back: Picture, region: PixelRect, seconds: float, parts: Sequence[tuple[Floats, float]]) -> None:
        """Learn from a region's back-projection. parts: (centre (2,), half width) of body parts, reduced px."""
        if self._share is None:
            return
        skin = cv2.threshold(back, SKIN, 255, cv2.THRESH_BINARY)[1]
        rise, fall = (1 - float(np.exp(-seconds / constant)) for constant in (RISE_S, FALL_S))
        if self._first:  # skin in the first picture is background until it moves
            rise, self._first = 1.0, False
        unowned = skin.copy()
        for centre, half in parts:
            u, v = centre - region.origin
            cv2.circle(unowned, (int(u), int(v)), max(int(half), 1), 0, -1)
        share = region.cut(self._share)
        cv2.accumulateWeighted(skin, share, rise, unowned)
        cv2.accumulateWeighted(skin, share, fall, cv2.bitwise_not(skin))

    def clear(self, centre: Floats, half: float) -> None:
        """Forget the background about a hand that moved: (2,) and half width in px of the reduced picture."""
        if self._share is not None:
            PixelRect.around(centre, (half, half), self._share.shape).cut(self._share)[:] = 0


NOISE_LEVELS = 12
"""Grey differences (0 to 255) below this are noise; the threshold rises where the whole picture flickers."""
BACKGROUND_S = 3.0
"""Time constant of the background, s."""
BODY_RATE = 0.1
"""Body parts become background at this fraction of the rate, so that a hand may rest."""
_SPREAD = np.ones((3, 3), np.uint8)


class ForegroundDetector:
    """Foreground by differences from the previous picture and from a running-average background."""

    def __init__(self) -> None:
        self._before: Picture | None = None
        self._background: Picture | None = None

    def update(
        self, picture: Picture, seconds: float, parts: Sequence[tuple[Floats, float]]
    ) -> tuple[Picture, Picture]:
        """(H, W, 3) BGR -> masks (H, W) uint8, 0 or 255: differs from the previous frame; differs from the background.

        parts: (centre (2,), side) px of the body parts seen last. Another size of picture starts over.
        """
        grey = cv2.blur(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), (3, 3))
        if self._before is None or self._background is None or self._before.shape != grey.shape:
            self._before, self._background = grey, grey.astype(np.float32)
        moved = _differs(grey, self._before)
        foreground = _differs(grey, cv2.convertScaleAbs(self._background))
        rate, still = 1 - float(np.exp(-seconds / BACKGROUND_S)), np.full(grey.shape, 255, np.uint8)
        for centre, side in parts:
            cv2.circle(still, (int(centre[0]), int(centre[1])), max(int(side), 1), 0, -1)
        cv2.accumulateWeighted(grey, self._background, (1 - BODY_RATE) * rate, still)
        cv2.accumulateWeighted(grey, self._background, BODY_RATE * rate)
        self._before = grey
        return moved, foreground


def _differs(one: Picture, other: Picture) -> Picture:
    difference = cv2.absdiff(one, other)
    # The median is the change of light and sensor noise over the whole picture; a person covers less than half of it.
    sample = difference[::8, ::8].ravel()
    threshold = NOISE_LEVELS + int(np.partition(sample, sample.size // 2)[sample.size // 2])
    return cv2.dilate(cv2.threshold(difference, threshold, 255, cv2.THRESH_BINARY)[1], _SPREAD)
