"""Skin colour of the person in front of the camera: a histogram of rotated hue and saturation."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.tracks import Floats

Picture = NDArray[Any]
HUES, SATURATIONS = 45, 32
HUE_SHIFT = 90
"""Skin lies about hue 0, where OpenCV's hue (0 to 179) wraps around; rotated by 90 it lies in the middle."""
DARK, BURNT, PALE = 40, 252, 12
"""Values (0 to 255) under which, over which, and saturations under which hue is noise."""
MIN_PIXELS = 60
"""Fewer usable pixels than these do not teach a histogram."""


def hue_saturation(picture: Picture) -> tuple[Picture, Picture]:
    """(H, W, 3) BGR uint8 -> bins (H, W) of hue and saturation, and the mask (H, W) uint8 of pixels worth using."""
    hsv = cv2.cvtColor(picture, cv2.COLOR_BGR2HSV)
    hue = (hsv[..., 0].astype(np.int32) + HUE_SHIFT) % 180 * HUES // 180
    bins = hue * SATURATIONS + hsv[..., 1].astype(np.int32) * SATURATIONS // 256
    usable = cv2.inRange(hsv, (0, PALE, DARK), (180, 255, BURNT))
    return bins, usable


def _count(bins: Picture, mask: Picture) -> Floats:
    counts = np.bincount(bins[mask > 0], minlength=HUES * SATURATIONS).astype(np.float32).reshape(HUES, SATURATIONS)
    smooth: Floats = cv2.GaussianBlur(counts, (5, 5), 1.0, borderType=cv2.BORDER_REPLICATE).astype(np.float64)
    frequencies: Floats = smooth / max(float(smooth.sum()), 1e-9)
    return frequencies


@dataclass(frozen=True, slots=True)
class Skin:
    """Frequencies of the bins, each (45, 32) and of sum 1, in the person's skin and in the rest of the picture."""

    skin: Floats
    rest: Floats

    @classmethod
    def learn(cls, picture: Picture, box: tuple[int, int, int, int]) -> "Skin | None":
        """From the ellipse in `box` (x, y, width, height) of a face or marked region; None: too few usable pixels."""
        bins, usable = hue_saturation(picture)
        x, y, w, h = box
        ellipse = np.zeros_like(usable)
        cv2.ellipse(ellipse, (x + w // 2, y + h // 2), (max(w * 3 // 10, 1), max(h * 4 // 10, 1)), 0, 0, 360, 255, -1)
        inside = cv2.bitwise_and(usable, ellipse)
        if cv2.countNonZero(inside) < MIN_PIXELS:
            return None
        outside = usable.copy()
        outside[max(y - h // 4, 0) : y + h * 5 // 4, max(x - w // 4, 0) : x + w * 5 // 4] = 0
        return cls(_count(bins, inside), _count(bins, outside))

    def adapted(self, newer: "Skin", rate: float) -> "Skin":
        """A step of `rate` (0 to 1) towards a newer one: light changes slowly."""
        return Skin(self.skin + rate * (newer.skin - self.skin), self.rest + rate * (newer.rest - self.rest))

    def back_project(self, picture: Picture) -> Picture:
        """(H, W) uint8: 255 p(skin | colour) with skin and rest equally likely beforehand; 0 where colour is no use."""
        bins, usable = hue_saturation(picture)
        ratio = self.skin / (self.skin + self.rest + 2e-4)
        table = (255 * ratio).astype(np.uint8).ravel()
        return cv2.bitwise_and(table[bins], usable)

    def save(self, path: Path) -> None:
        """Write to an .npz file."""
        with path.open("wb") as file:
            np.savez(file, skin=self.skin, rest=self.rest)

    @classmethod
    def load(cls, path: Path) -> "Skin":
        """Read what `save` wrote; BadInput for anything else."""
        expected = f"a skin histogram of two arrays ({HUES}, {SATURATIONS}) is expected; learn it again"
        try:
            with np.load(path, allow_pickle=False) as file:
                skin, rest = (np.asarray(file[name], dtype=np.float64) for name in ("skin", "rest"))
        except (OSError, ValueError, KeyError, EOFError) as error:
            raise BadInput(f"{path}: {type(error).__name__}; {expected}") from None
        for counts in (skin, rest):
            if counts.shape != (HUES, SATURATIONS) or not (np.isfinite(counts).all() and (counts >= 0).all()):
                raise BadInput(f"{path}: shape {counts.shape} or values below zero; {expected}")
        return cls(skin, rest)
