"""Laban's Shape while the movement goes on: spreading or enclosing, rising or sinking, advancing or retreating. Pure.

Three points suffice and nothing is learned: the rate r of a length over the last half second is measured with a noise
of NOISE, and what is slower than SLOW either way is neither. With a flat prior on the true rate (docs/design/effort.md)

    P(grows) = Φ((r - SLOW)/NOISE)    P(shrinks) = Φ((-r - SLOW)/NOISE)    P(neither) = the rest
"""

import math
from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from observer.effort.formulas import advancing, rising, spreading
from observer.features.space import BodySize
from observer.geometry.projection import oriented
from observer.tracks import BODY_PARTS, Floats

WINDOW_S = 0.5
"""Rates are taken over this time: about one stroke."""
SLOW = 0.3
"""Body sizes a second: slower is neither; a hand that is lowered in two seconds is faster."""
NOISE = 0.15
"""Body sizes a second: how far the rate of a still hand may seem from 0, with a tracker that trembles."""
JUDGED_HZ = 10.0
"""So often it is judged."""
FEWEST = 4
"""Instants that a rate needs."""
DEPTH_SHOWN = 0.5
"""A view shows advancing when at least half of a step forward is seen as one aside: from 30° of yaw on."""


class ShapeReader:
    """Reads Shape from the stream of tracks. body_parts: names of the P parts; depth: see `depth_in`."""

    def __init__(self, body_parts: Sequence[str], rate_hz: float, depth: float = 0.0) -> None:
        names = list(body_parts)
        self._rows = [names.index(part) if part in names else None for part in BODY_PARTS]
        self._names, self._rate_hz, self._depth = tuple(names), rate_hz, depth
        self._size = BodySize()
        self._window: deque[Floats] = deque(maxlen=max(round(WINDOW_S * rate_hz), FEWEST))
        self._every, self._count = max(round(rate_hz / JUDGED_HZ), 1), 0
        self._said: dict[str, Floats] = {}

    def update(self, centres: Floats) -> dict[str, Floats]:
        """(P, 2) image coordinates, v down -> the facets shape_* that can be judged now, (3,) each.

        Left out: spreading as long as a hand or the head is not seen, the others without any hand or the head, and
        advancing where the view does not show depth.
        """
        size = self._size.update(centres, self._names) if None not in self._rows else math.nan
        points = np.array([centres[row] if row is not None else (np.nan, np.nan) for row in self._rows])
        self._window.append(points * (1.0, -1.0))
        self._count += 1
        if math.isfinite(size) and self._count % self._every == 0:
            self._said = self._judged(np.array(self._window) / size)
        return self._said

    def _judged(self, points: Floats) -> dict[str, Floats]:
        """(T, 3, 2) in body sizes, right and up."""
        seen: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(points), axis=2)
        found: dict[str, Floats] = {}
        if seen.all(axis=1).sum() >= FEWEST:
            found["shape_horizontal"] = three_ways(spreading(points, self._rate_hz))
        if (seen[:, :2].any(axis=1) & seen[:, 2]).sum() >= FEWEST:
            found["shape_vertical"] = three_ways(rising(points, self._rate_hz))
            if abs(self._depth) >= DEPTH_SHOWN:
                found["shape_sagittal"] = three_ways(advancing(points, self._rate_hz, back=0) / self._depth)
        return found


def three_ways(rate: float) -> Floats:
    """A rate in body sizes a second -> (3,) P(shrinks), P(neither), P(grows), in the order of the facets' values."""
    shrinks, grows = _normal((-rate - SLOW) / NOISE), _normal((rate - SLOW) / NOISE)
    return np.array([shrinks, max(1.0 - shrinks - grows, 0.0), grows])


def depth_in(matrix: Floats) -> float:
    """(3, 4) projective matrix -> how far the picture's right is the performer's back, -1 to 1; 0 is the Door.

    The first row of the matrix's left part, without its share along the optical axis, the third row.
    """
    right, axis = oriented(matrix)[[0, 2], :3]
    if axis.any():
        right = right - axis * (right @ axis) / (axis @ axis)
    return float(right[2] / np.linalg.norm(right))


def _normal(x: float) -> float:
    return 0.5 * math.erfc(-x / math.sqrt(2.0))
