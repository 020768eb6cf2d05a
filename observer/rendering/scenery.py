"""Everything in a rendered picture except the performer: background and noise."""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from common.errors import BadInput
from observer.rendering.figure import Bgr
from observer.tracks import Picture

BACKGROUNDS = ("plain", "cluttered", "skin_toned")
"""A bare wall; shelves and boxes of many colours, none like skin; a beige wall and wood with hues near skin."""


MOST_NOISE_LEVELS, WEBCAM_NOISE = 64.0, 2.0
"""Of 255 grey levels: the most, and that of a webcam in a lit room."""


@dataclass(frozen=True, slots=True)
class Scenery:
    """Everything except the performer; by default a plain wall and a perfect camera.

    noise: standard deviation of each pixel and channel, grey levels. Raises BadInput for an unknown background and for
    noise out of range.
    """

    background: str = "plain"
    noise: float = 0.0

    def __post_init__(self) -> None:
        if self.background not in BACKGROUNDS:
            raise BadInput(f"background = {self.background!r}: unknown background; known: {', '.join(BACKGROUNDS)}")
        if not 0.0 <= self.noise <= MOST_NOISE_LEVELS:
            raise BadInput(f"noise = {self.noise}: 0 to {MOST_NOISE_LEVELS:g} is expected")


_HORIZON = 0.8  # upper edge of the floor, share of the picture's height


@lru_cache(maxsize=8)
def background(kind: str, size_px: tuple[int, int], seed: int) -> Picture:
    """(H, W, 3) a background: kind, one of BACKGROUNDS, size (width, height), seed of the layout; read-only."""
    rng = np.random.default_rng((seed, 2))
    width, height = size_px
    picture = {"plain": _plain, "cluttered": _cluttered, "skin_toned": _skin_toned}[kind](width, height, rng)
    picture.setflags(write=False)
    return picture


def _plain(width: int, height: int, rng: np.random.Generator) -> Picture:
    """A grey-blue wall and a darker floor, each brighter at the top."""
    tint = rng.uniform(-8.0, 8.0)
    wall = _wash(width, height, (188.0 + tint, 176.0, 164.0 - tint), 0.12)
    horizon = int(_HORIZON * height)
    wall[horizon:] = _wash(width, height - horizon, (128.0, 126.0, 118.0), 0.2)
    return wall


def _cluttered(width: int, height: int, rng: np.random.Generator) -> Picture:
    """Shelves of books and boxes, a patterned curtain, pictures on the wall, boxes on the floor."""
    picture = _plain(width, height, rng)
    for _ in range(2):
        left = int(rng.uniform(0.0, 0.65) * width)
        _shelf(picture, left, int(rng.uniform(0.02, 0.2) * height), int(0.32 * width), int(0.62 * height), rng)
    curtain = int(rng.uniform(0.05, 0.75) * width)
    _stripes(picture, curtain, int(0.18 * width), int(0.75 * height), rng)
    for _ in range(24):
        w, h = rng.uniform(0.04, 0.16, 2) * (width, height)
        x, y = rng.uniform(-0.02, 0.95) * width, rng.uniform(0.0, 0.92) * height
        _thing(picture, int(x), int(y), int(w), int(h), rng)
    return picture


def _skin_toned(width: int, height: int, rng: np.random.Generator) -> Picture:
    """A beige wall, a wooden cupboard and a wooden floor, with hues of 8 to 18 of 180 like skin."""
    picture = _wash(width, height, (150.0, 180.0, 208.0), 0.1)
    wide = int(rng.uniform(0.3, 0.45) * width)
    left = int(rng.uniform(0.05, 0.5) * width)
    top = int(rng.uniform(0.15, 0.3) * height)
    picture[top:, left : left + wide] = _wood(wide, height - top, rng)
    for k in range(4):
        cv2.rectangle(picture, (left + k * wide // 3, top), (left + k * wide // 3, height), (52, 78, 110), 2)
    horizon = int(_HORIZON * height)
    floor = np.ascontiguousarray(_wood(height - horizon, width, rng).transpose(1, 0, 2))
    picture[horizon:] = floor
    for y in range(horizon, height, max(height // 30, 4)):
        cv2.line(picture, (0, y), (width, y), (58, 84, 118), 1)
    return picture


def _shelf(picture: Picture, left: int, top: int, wide: int, high: int, rng: np.random.Generator) -> None:
    cv2.rectangle(picture, (left, top), (left + wide, top + high), (66, 64, 60), -1)
    board = max(high // 4, 8)
    for y in range(top + board, top + high + 1, board):
        x = left + 4
        while x < left + wide - 10:
            w, h = int(rng.uniform(0.03, 0.11) * wide) + 3, int(rng.uniform(0.55, 0.92) * board)
            cv2.rectangle(picture, (x, y - h), (min(x + w, left + wide - 4), y), _non_skin_colour(rng), -1)
            x += w + 1
        cv2.line(picture, (left, y), (left + wide, y), (120, 122, 124), 3)


def _stripes(picture: Picture, left: int, wide: int, high: int, rng: np.random.Generator) -> None:
    colours = [_non_skin_colour(rng) for _ in range(3)]
    for k, x in enumerate(range(left, left + wide, max(wide // 14, 2))):
        cv2.rectangle(picture, (x, 0), (x + max(wide // 14, 2), high), colours[k % 3], -1)


def _thing(picture: Picture, x: int, y: int, wide: int, high: int, rng: np.random.Generator) -> None:
    """A box, plain or with a checked or dotted front."""
    cv2.rectangle(picture, (x, y), (x + wide, y + high), _non_skin_colour(rng), -1)
    pattern, other = rng.integers(3), _non_skin_colour(rng)
    step = max(min(wide, high) // 4, 4)
    for i in range(x + 2, x + wide - step, 2 * step):
        for j in range(y + 2, y + high - step, 2 * step):
            if pattern == 1:
                cv2.rectangle(picture, (i, j), (i + step, j + step), other, -1)
            elif pattern == 2:
                cv2.circle(picture, (i + step // 2, j + step // 2), step // 2, other, -1, cv2.LINE_AA)
    cv2.rectangle(picture, (x, y), (x + wide, y + high), (40, 38, 36), 1)


def _non_skin_colour(rng: np.random.Generator) -> tuple[int, int, int]:
    """A colour of any hue except skin's (about 0 to 25 and 165 to 180 of OpenCV's 180), or a grey."""
    hue, saturation = rng.integers(38, 150), rng.integers(0, 3) * rng.integers(30, 100)
    hsv = np.array([[[hue, saturation, rng.integers(50, 230)]]], np.uint8)
    blue, green, red = cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR)[0, 0]
    return int(blue), int(green), int(red)


def _wood(width: int, height: int, rng: np.random.Generator) -> Picture:
    """(height, width, 3) wood with a vertical grain."""
    white = rng.normal(0.0, 1.0, (height, width)).astype(np.float32)
    grain = np.asarray(cv2.GaussianBlur(white, (0, 0), 1.2, sigmaY=40.0), dtype=np.float32)
    grain /= max(float(grain.std()), 1e-6)
    tone = np.array(rng.uniform((75.0, 112.0, 160.0), (105.0, 142.0, 190.0)), np.float32)
    return np.clip(tone * (1.0 + 0.07 * grain[..., None]), 0.0, 255.0).astype(np.uint8)


def _wash(width: int, height: int, colour: Bgr, fall: float) -> Picture:
    """One colour that darkens towards the bottom by the share `fall`."""
    gradient = np.linspace(1.0, 1.0 - fall, height, dtype=np.float32)[:, None, None] * np.array(colour, np.float32)
    return np.broadcast_to(np.clip(gradient, 0.0, 255.0).astype(np.uint8), (height, width, 3)).copy()


GRAIN = 4  # key of the random stream, after the seed
_TILE = 61  # largest shift of the grain in px, so that no pattern repeats visibly


def add_noise(picture: Picture, scenery: Scenery, seed: int, frame_number: int) -> Picture:
    """The picture with the noise of that frame: Gaussian, independent for each pixel and channel, rounded."""
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
    """Positive and negative parts of a noise field larger than the picture: a new field per frame would be too slow."""
    rng = np.random.default_rng((seed, GRAIN))
    grain = np.rint(rng.normal(0.0, noise, (size_px[1] + _TILE, size_px[0] + _TILE, 3)))
    above, below = (np.clip(part, 0, 255).astype(np.uint8) for part in (grain, -grain))
    return above, below
