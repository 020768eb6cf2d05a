"""What has the colour of skin and was there all the time: shelves, doors, walls. A hand that rests is none of it."""

from collections.abc import Sequence

import cv2
import numpy as np

from observer.tracking.skin import Picture
from observer.tracking.window import SKIN, Region
from observer.tracks import Floats

RISE_S, FALL_S = 1.0, 1.0
"""Time constants with which a place becomes backdrop while it shows skin that is no part's, and ceases to be."""
HALF = 0.2


class Backdrop:
    """How long each place of a shrunk picture has shown skin that belongs to nobody, 0 to 255 as a share."""

    def __init__(self) -> None:
        self._shown: Picture | None = None
        self._first = True

    def stale(self, region: Region, shape: tuple[int, ...]) -> Picture:
        """(h, w) uint8 of the region, 255 where skin is backdrop; another `shape` of the picture begins anew."""
        if self._shown is None or self._shown.shape != shape[:2]:
            self._shown, self._first = np.zeros(shape[:2], np.float32), True
        return (region.cut(self._shown) > HALF * 255).astype(np.uint8) * 255

    def learn(self, back: Picture, region: Region, seconds: float, parts: Sequence[tuple[Floats, float]]) -> None:
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
            Region.around(centre, (half, half), self._shown.shape).cut(self._shown)[:] = 0
