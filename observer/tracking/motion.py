"""What moves: the second cue where the background has the colour of skin."""

from collections.abc import Sequence

import cv2
import numpy as np

from observer.tracking.skin import Picture
from observer.tracks import Floats

NOISE_LEVELS = 12
"""Differences of grey below this many of 255 are noise; more where the whole picture flickers."""
MEMORY_S = 3.0
"""Time constant of the background."""
RESTING = 0.1
"""What was seen of the person becomes background so much more slowly, so that a hand may rest."""
_SPREAD = np.ones((3, 3), np.uint8)


class Motion:
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
