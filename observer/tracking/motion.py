"""What moves: the second cue where the background has the colour of skin."""

from collections.abc import Sequence

import cv2
import numpy as np

from observer.tracking.skin import Picture
from observer.tracks import Floats

NOISE_LEVELS = 12.0
"""Differences of grey below this many of 255 are noise; more where the whole picture flickers."""
MEMORY_S = 3.0
"""Time constant of the background."""


class Motion:
    """Foreground: what differs from the picture before or from a slowly learned background, at half the resolution."""

    def __init__(self) -> None:
        self._before: Picture | None = None
        self._background: Picture | None = None

    def update(
        self, picture: Picture, seconds: float, parts: Sequence[tuple[Floats, float]]
    ) -> tuple[Picture, Picture]:
        """(H, W, 3) BGR -> masks (H, W) uint8, 0 or 255: differs from the frame before; or from that or the background.

        parts: (centre (2,), side) px of what was seen there last: it becomes background ten times as slowly, so that a
        hand may rest.
        """
        height, width = picture.shape[:2]
        small = cv2.resize(picture, (max(width // 2, 1), max(height // 2, 1)), interpolation=cv2.INTER_AREA)
        grey = cv2.GaussianBlur(cv2.cvtColor(small, cv2.COLOR_BGR2GRAY), (5, 5), 0).astype(np.float32)
        if self._before is None or self._background is None or self._before.shape != grey.shape:
            self._before, self._background = grey, grey.copy()
        moved = _differs(grey, self._before)
        foreground = cv2.bitwise_or(moved, _differs(grey, self._background))
        rate, still = 1 - float(np.exp(-seconds / MEMORY_S)), np.full(grey.shape, 255, np.uint8)
        for centre, side in parts:
            cv2.circle(still, (int(centre[0] / 2), int(centre[1] / 2)), max(int(side / 2), 1), 0, -1)
        cv2.accumulateWeighted(grey, self._background, 0.9 * rate, still)
        cv2.accumulateWeighted(grey, self._background, 0.1 * rate)
        self._before = grey
        size = (width, height)
        moved = cv2.resize(moved, size, interpolation=cv2.INTER_NEAREST)
        return moved, cv2.resize(foreground, size, interpolation=cv2.INTER_NEAREST)


def _differs(one: Picture, other: Picture) -> Picture:
    difference = cv2.absdiff(one, other)
    # The median is what light and sensor do to the whole picture; a person covers less than half of it.
    threshold = NOISE_LEVELS + float(np.median(difference[::4, ::4]))
    mask = (difference > threshold).astype(np.uint8) * 255
    return cv2.dilate(mask, np.ones((5, 5), np.uint8))
