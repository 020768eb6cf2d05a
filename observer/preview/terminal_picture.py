"""A picture as coloured characters of a terminal, two pixels in each: enough to see who is in it. Pure."""

import cv2
import numpy as np

from observer.preview.sight import Picture

UPPER_HALF = "▀"
"""Its foreground is the upper pixel, its background the lower one."""
RESET = "\x1b[0m"
CUBE_LEVELS = 6
"""Of each colour in the cube of terminals with 256 colours, which begins at CUBE."""
CUBE = 16


def picture_lines(picture: Picture, columns: int, lines: int, *, exact: bool = True) -> list[str]:
    """(H, W, 3) uint8 BGR -> at most `lines` lines of at most `columns` characters, in the picture's shape.

    exact: in 16 million colours; else in 216, which more terminals know.
    """
    height, width = picture.shape[:2]
    scale = min(columns / width, 2 * lines / height)
    size = max(round(width * scale), 1), max(2 * round(height * scale / 2), 2)
    small = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))[:, :, ::-1]
    return [
        "".join(_cell(upper, lower, exact) for upper, lower in zip(small[row], small[row + 1], strict=True)) + RESET
        for row in range(0, len(small), 2)
    ]


def _cell(upper: Picture, lower: Picture, exact: bool) -> str:
    return f"\x1b[38;{_colour(upper, exact)};48;{_colour(lower, exact)}m{UPPER_HALF}"


def _colour(rgb: Picture, exact: bool) -> str:
    red, green, blue = (int(value) for value in rgb)
    if exact:
        return f"2;{red};{green};{blue}"
    red, green, blue = (round(value / 255 * (CUBE_LEVELS - 1)) for value in (red, green, blue))
    return f"5;{CUBE + CUBE_LEVELS * CUBE_LEVELS * red + CUBE_LEVELS * green + blue}"
