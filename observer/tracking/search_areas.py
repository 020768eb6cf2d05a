"""Where to search for people: the whole picture, and overlapping squares of it for small people. Pure.

MediaPipe's detector finds people whose height is between 0.35 times and once the side of what it looks at
(docs/results/trackers.md). Neighbouring squares overlap by half, so a person of up to half a square's side is complete
in at least one of them.
"""

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.tracking.people import GRID_PX, Rgb, SearchArea

SHARES = (1.0, 2 / 3, 1 / 2)
"""Sides of the squares, of the short side of the picture: in 640x480, people down to 84 px."""
CHANGED = 8
"""Change of a cell's mean green, of 255, that counts as motion; noise of cameras stays below."""
STIRRED = 6
"""Changed cells from which something moved."""
AREA_LEAST_PX = 32
"""Smaller squares are not searched."""
LEAST_MS = 90
"""Pictures that follow sooner are not compared."""
SAMPLED = 240
"""Of a large picture about so many rows or columns are read, whichever are fewer."""


def search_levels(width: int, height: int) -> list[list[SearchArea]]:
    """The whole picture, then the squares of each size, large ones first; from the middle outwards."""
    levels, short = [[SearchArea(0, 0, width, height)]], min(width, height)
    for share in SHARES:
        side = round(short * share)
        if AREA_LEAST_PX <= side < max(width, height):
            squares = [SearchArea(u, v, side, side) for v in _begins(height, side) for u in _begins(width, side)]
            levels.append(sorted(squares, key=lambda area: _off_centre(area, width, height)))
    return levels


def _begins(length: int, side: int) -> list[int]:
    """Where squares begin: evenly, overlapping by at least half, from edge to edge."""
    count = math.ceil((length - side) / (side / 2)) + 1
    return sorted({round(n * (length - side) / max(count - 1, 1)) for n in range(count)})


def _off_centre(area: SearchArea, width: int, height: int) -> float:
    return math.hypot(area.left + area.width / 2 - width / 2, area.top + area.height / 2 - height / 2)


class Sweep:
    """Passes through all areas again and again: first those that hold the mark, then those in which something moves.

    size: width and height of the pictures, px. mark: shares of both; None: no mark.
    """

    def __init__(self, size: tuple[int, int], mark: tuple[float, float] | None = None) -> None:
        self.size = size
        self._mark = None if mark is None else (mark[0] * size[0], mark[1] * size[1])
        self._levels = search_levels(*size)
        self._due: list[tuple[int, SearchArea]] = []
        self.passes = 0
        """Complete passes so far."""

    @property
    def whole(self) -> SearchArea:
        """The whole picture."""
        return self._levels[0][0]

    def next(self, count: int, motion: "NDArray[np.bool_] | None") -> list[tuple[int, SearchArea]]:
        """Up to `count` squares that are due, each with its level; none for a square picture of one level.

        motion: (h, w) where the picture changes, see `MotionGrid`; None: unknown.
        """
        self._begin_if_done()
        if motion is not None and motion.sum() >= STIRRED:
            self._due.sort(key=lambda each: (not self._is_marked(each[1]), -_moving(each[1], motion)))
        return self._taken(self._due[:count])

    def rest_of(self, level: int) -> list[tuple[int, SearchArea]]:
        """The squares that are still due and may hold a better candidate than those found in that level: the others of
        its size, or those that hold the mark."""
        self._begin_if_done()
        return self._taken(
            [(n, area) for n, area in self._due if (n == level if self._mark is None else self._is_marked(area))]
        )

    def _begin_if_done(self) -> None:
        if not self._due:
            self._due = [(n, area) for n, level in enumerate(self._levels) for area in level if n]
            self._due.sort(key=lambda each: not self._is_marked(each[1]))

    def _is_marked(self, area: SearchArea) -> bool:
        return self._mark is not None and area.holds(*self._mark)

    def _taken(self, areas: Sequence[tuple[int, SearchArea]]) -> list[tuple[int, SearchArea]]:
        due = len(self._due)
        self._due = [each for each in self._due if each not in areas]
        self.passes += bool(due) and not self._due
        return list(areas)


def _moving(area: SearchArea, motion: NDArray[np.bool_]) -> float:
    """Share of the square in which something moves; a little is added for small squares that hold the same."""
    part = area.of_grid(motion)
    return float(part.sum()) / math.sqrt(max(part.size, 1))


class MotionGrid:
    """Where a picture differs from an earlier one, in cells of GRID_PX; cheap enough for each picture."""

    def __init__(self) -> None:
        self._previous: NDArray[np.uint8] | None = None
        self._changed: NDArray[np.bool_] | None = None
        self._ms = 0

    def update(self, rgb: Rgb, ms: int) -> NDArray[np.bool_] | None:
        """(H, W, 3) -> (H/8, W/8) whether it changed; None for the first picture, and after another size.

        Pictures less than LEAST_MS apart are not compared: the result is that of the last comparison.
        """
        size = max(rgb.shape[1] // GRID_PX, 1), max(rgb.shape[0] // GRID_PX, 1)
        if self._previous is not None and self._previous.shape[::-1] == size and ms - self._ms < LEAST_MS:
            return self._changed
        step = max(GRID_PX // 4, min(rgb.shape[:2]) // SAMPLED)
        cells = cv2.resize(np.ascontiguousarray(rgb[::step, ::step, 1]), size, interpolation=cv2.INTER_AREA)
        grid = np.asarray(cells, dtype=np.uint8)
        previous, self._previous, self._ms = self._previous, grid, ms
        same = previous is not None and previous.shape == grid.shape
        self._changed = cv2.absdiff(grid, previous) > CHANGED if same and previous is not None else None
        return self._changed
