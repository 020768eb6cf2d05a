"""What spoils a picture, by seed and frame number alone: changing light, sensor noise, a box in the way."""

import math
from functools import lru_cache

import cv2
import numpy as np

from observer.rendering.canvas import NOBODY, Canvas, Picture
from observer.rendering.scenery import Scenery

LIGHT, GRAIN = 3, 4  # the second number of each stream of chance, after the seed
BOX_COLOURS = ((92, 70, 48), (116, 92, 66))
_TILE = 61  # pixels that the grain may be shifted by; larger than any pattern is remembered


def occlude(canvas: Canvas, scenery: Scenery, frame_number: int) -> None:
    """Put the boxes of that frame before all that is drawn: bluish, striped, the same whatever the seed."""
    rows, columns = canvas.owner.shape
    for box in scenery.occluders:
        if not box.covers(frame_number):
            continue
        left, right = round(box.left * columns), round((box.left + box.width) * columns)
        top, bottom = round(box.top * rows), round((box.top + box.height) * rows)
        if left >= right or top >= bottom:
            continue
        canvas.owner[top:bottom, left:right] = NOBODY
        canvas.picture[top:bottom, left:right] = BOX_COLOURS[0]
        for y in range(top, min(bottom, rows), 12):
            canvas.picture[y : min(y + 4, bottom), left:right] = BOX_COLOURS[1]


def gains(scenery: Scenery, seed: int, frame_number: int) -> tuple[float, float, float]:
    """By what blue, green and red are multiplied in that frame; all 1 in steady light and before the first jump."""
    swing = 1.0 + scenery.slow_light * math.sin(2 * math.pi * frame_number / scenery.slow_frames)
    jump = frame_number // scenery.sudden_frames
    if not (scenery.sudden_light and jump):
        return swing, swing, swing
    brightness, warmth = np.random.default_rng((seed, LIGHT, jump)).uniform(-1.0, 1.0, 2) * scenery.sudden_light
    level = swing * (1.0 + float(brightness))
    warm = 0.2 * float(warmth)
    return level * (1.0 - warm), level, level * (1.0 + warm)


def relight(picture: Picture, scenery: Scenery, seed: int, frame_number: int) -> Picture:
    """The picture in that frame's light; bright parts burn out at 255."""
    factors = gains(scenery, seed, frame_number)
    if factors == (1.0, 1.0, 1.0):
        return picture
    table = np.clip(np.arange(256.0)[:, None] * factors + 0.5, 0.0, 255.0).astype(np.uint8)
    return np.asarray(cv2.LUT(picture, table[None]), dtype=np.uint8)


def add_noise(picture: Picture, scenery: Scenery, seed: int, frame_number: int) -> Picture:
    """The picture with that frame's noise: normal, independent in every pixel and channel, rounded."""
    if not scenery.noise:
        return picture
    rows, columns = picture.shape[:2]
    above, below = _grain((columns, rows), scenery.noise, seed)
    y, x, swapped = np.random.default_rng((seed, GRAIN, frame_number)).integers((_TILE, _TILE, 2))
    window = slice(y, y + rows), slice(x, x + columns)
    if swapped:
        above, below = below, above
    return np.asarray(cv2.subtract(cv2.add(picture, above[window]), below[window]), dtype=np.uint8)


@lru_cache(maxsize=4)
def _grain(size_px: tuple[int, int], noise: float, seed: int) -> tuple[Picture, Picture]:
    """What is added and what is taken away, larger than a picture: drawing it anew would cost more than a picture."""
    rng = np.random.default_rng((seed, GRAIN))
    grain = np.rint(rng.normal(0.0, noise, (size_px[1] + _TILE, size_px[0] + _TILE, 3)))
    above, below = (np.clip(part, 0, 255).astype(np.uint8) for part in (grain, -grain))
    return above, below
