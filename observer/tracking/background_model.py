"""Foreground and background: which pixels move, and which skin-coloured places belong to the room."""

from collections.abc import Sequence

import cv2
import numpy as np

from observer.tracking.back_projection import SKIN, PixelRect
from observer.tracking.skin import Picture
from observer.tracks import Floats

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
MEMORY_S = 3.0
"""Time constant of the background, s."""
RESTING = 0.1
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
        rate, still = 1 - float(np.exp(-seconds / MEMORY_S)), np.full(grey.shape, 255, np.uint8)
        for centre, side in parts:
            cv2.circle(still, (int(centre[0]), int(centre[1])), max(int(side), 1), 0, -1)
        cv2.accumulateWeighted(grey, self._background, (1 - RESTING) * rate, still)
        cv2.accumulateWeighted(grey, self._background, RESTING * rate)
        self._before = grey
        return moved, foreground


def _differs(one: Picture, other: Picture) -> Picture:
    difference = cv2.absdiff(one, other)
    # The median is the change of light and sensor noise over the whole picture; a person covers less than half of it.
    sample = difference[::8, ::8].ravel()
    threshold = NOISE_LEVELS + int(np.partition(sample, sample.size // 2)[sample.size // 2])
    return cv2.dilate(cv2.threshold(difference, threshold, 255, cv2.THRESH_BINARY)[1], _SPREAD)
