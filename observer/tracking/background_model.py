"""Foreground and background: which pixels move, and which skin-coloured places belong to the room."""

from collections.abc import Sequence

import cv2
import numpy as np

from observer.tracking.back_projection import SKIN, PixelRect
from observer.tracking.skin import Picture
from observer.tracks import Floats

RISE_S, FALL_S = 1.0, 1.0
"""Time constants with which a place becomes backdrop while it shows skin that is no part's, and ceases to be."""
HALF = 0.2


class SkinBackground:
    """How long each place of a shrunk picture has shown skin that belongs to nobody, 0 to 255 as a share."""

    def __init__(self) -> None:
        self._shown: Picture | None = None
        self._first = True

    def stale(self, region: PixelRect, shape: tuple[int, ...]) -> Picture:
        """(h, w) uint8 of the region, 255 where skin is backdrop; another `shape` of the picture begins anew."""
        if self._shown is None or self._shown.shape != shape[:2]:
            self._shown, self._first = np.zeros(shape[:2], np.float32), True
        return (region.cut(self._shown) > HALF * 255).astype(np.uint8) * 255

    def learn(self, back: Picture, region: PixelRect, seconds: float, parts: Sequence[tuple[Floats, float]]) -> None:
        """A region's back-projection; parts: (centre (2,), half width) of what is none, px of the shrunk picture."""
        if self._shown is None:
            return
        skin = cv2.threshold(back, SKIN, 255, cv2.THRESH_BINARY)[1]
        rise, fall = (1 - float(np.exp(-seconds / constant)) for constant in (RISE_S, FALL_S))
        if self._first:  # what is there at first is backdrop until it moves
            rise, self._first = 1.0, False
        nobodys = skin.copy()
        for centre, half in parts:
            u, v = centre - region.origin
            cv2.circle(nobodys, (int(u), int(v)), max(int(half), 1), 0, -1)
        shown = region.cut(self._shown)
        cv2.accumulateWeighted(skin, shown, rise, nobodys)
        cv2.accumulateWeighted(skin, shown, fall, cv2.bitwise_not(skin))

    def clear(self, centre: Floats, half: float) -> None:
        """What moved here was a hand: (2,) and half width in px of the shrunk picture."""
        if self._shown is not None:
            PixelRect.around(centre, (half, half), self._shown.shape).cut(self._shown)[:] = 0


NOISE_LEVELS = 12
"""Differences of grey below this many of 255 are noise; more where the whole picture flickers."""
MEMORY_S = 3.0
"""Time constant of the background."""
RESTING = 0.1
"""What was seen of the person becomes background so much more slowly, so that a hand may rest."""
_SPREAD = np.ones((3, 3), np.uint8)


class ForegroundDetector:
    """Foreground: what differs from the picture before or from a slowly learned background."""

    def __init__(self) -> None:
        self._before: Picture | None = None
        self._background: Picture | None = None

    def update(
        self, picture: Picture, seconds: float, parts: Sequence[tuple[Floats, float]]
    ) -> tuple[Picture, Picture]:
        """(H, W, 3) BGR -> masks (H, W) uint8, 0 or 255: differs from the frame before; differs from the background.

        parts: (centre (2,), side) px of what was seen there last. Another size of picture begins anew.
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
    # The median is what light and sensor do to the whole picture; a person covers less than half of it.
    sample = difference[::8, ::8].ravel()
    threshold = NOISE_LEVELS + int(np.partition(sample, sample.size // 2)[sample.size // 2])
    return cv2.dilate(cv2.threshold(difference, threshold, 255, cv2.THRESH_BINARY)[1], _SPREAD)
