"""Reads the facets of the current movement (docs/design/effort.md). Pure.

Effort since the movement's beginning, where rest ends; Shape of the last half second: spreading or enclosing, rising or
sinking, advancing or retreating, after Larboulette and Gibet, "A review of computable expressive descriptors of human
motion", MOCO 2015.
"""

import math
from collections import deque
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.effort.features import Course, features
from observer.effort.model import EffortModel
from observer.features import UP, BodySize
from observer.geometry.projection import picture_right
from observer.tracks import BODY_PARTS, Floats, Tracks

AT_REST, MOVING = 0.8, 0.5
"""Rest above the first ends a movement, below the second begins one; in between nothing changes."""
BEFORE_S = 0.2
"""This much of the time before a detected beginning belongs to the movement."""
EFFORT_HZ = 5.0
"""Rate at which Effort is updated: its features are of whole seconds, and a fifth of the frames costs a fifth."""
SHORTEST_S = 0.4
"""A shorter part of a movement tells nothing about its Effort."""
SHAPE_WINDOW_S = 0.5
"""Window of the rates of Shape: about one stroke."""
SLOW_SHAPE_PER_S = 0.3
"""Body sizes per second: a slower change is neither; a hand that is lowered in two seconds is faster."""
NOISE = 0.15
"""Body sizes per second: apparent rate of a still hand with a jittering tracker."""
SHAPE_HZ = 10.0
"""Rate at which Shape is updated."""
FEWEST_INSTANTS = 4
"""Instants that a rate needs."""
LEAST_DEPTH = 0.5
"""A view shows advancing if at least half of a step forward appears as one aside: from 30° of yaw on."""


class EffortReader:
    """Reads P(E_q | the movement so far) for each Effort factor; nothing at rest.

    body_parts: names of the P parts in the tracks; rate_hz: theirs. Raises BadInput if hands or head are missing.
    """

    def __init__(self, model: EffortModel, body_parts: Sequence[str], rate_hz: float) -> None:
        missing = [part for part in BODY_PARTS if part not in body_parts]
        if missing:
            raise BadInput(f"Effort: needs {missing[0]}; the movement model reads only {', '.join(body_parts)}")
        self._model, self._rate_hz = model, rate_hz
        self._rows = [list(body_parts).index(part) for part in BODY_PARTS]
        self._course = Course(BODY_PARTS, rate_hz)
        self._before = max(round(BEFORE_S * rate_hz), 1)
        self._every = max(round(rate_hz / EFFORT_HZ), 1)
        self._resting, self._since = True, 0
        self._facets: Mapping[str, Floats] = {}

    def update(self, tracks: Tracks, rest: float) -> Mapping[str, Floats]:
        """One frame, and the probability of rest in it -> facets effort_* so far, (2,) each; {} if unknown."""
        self._course.add(tracks.centres[self._rows])
        if self._resting and rest < MOVING:
            self._resting, self._since = False, 0
            self._course.begin(self._before)
        elif rest > AT_REST:
            self._resting, self._facets = True, {}
        if not self._resting:
            self._since += 1
            if self._since >= SHORTEST_S * self._rate_hz and self._since % self._every == 0:
                self._facets = self._posterior()
        return self._facets

    def _posterior(self) -> Mapping[str, Floats]:
        values = features(self._course)
        return self._model.posterior(values) if np.isfinite(values).any() else self._facets


class ShapeReader:
    """Reads Shape from the stream of tracks. body_parts: names of the P parts; depth: see `depth_in`."""

    def __init__(self, body_parts: Sequence[str], rate_hz: float, depth: float = 0.0) -> None:
        self._names, self._rate_hz, self._depth = tuple(body_parts), rate_hz, depth
        self._rows = [self._names.index(part) for part in BODY_PARTS if part in self._names]
        self._size = BodySize()
        self._window: deque[Floats] = deque(maxlen=max(round(SHAPE_WINDOW_S * rate_hz), FEWEST_INSTANTS))
        self._every, self._count = max(round(rate_hz / SHAPE_HZ), 1), 0
        self._facets: dict[str, Floats] = {}

    def update(self, centres: Floats, read: bool = True) -> dict[str, Floats]:
        """(P, 2) image coordinates, v down -> the facets shape_* that are known now, (3,) each.

        read: whether anybody reads them; else they stay as they were. Missing: spreading while a hand or the head is
        not seen, the others without any hand or the head, and advancing if the view does not show depth.
        """
        if len(self._rows) < len(BODY_PARTS):
            return {}
        self._window.append(centres[self._rows] * UP)
        self._count += 1
        if not read:
            return self._facets
        size = self._size.update(centres, self._names)
        if math.isfinite(size) and self._count >= self._every:
            self._count, self._facets = 0, self._posterior(np.array(self._window) / size)
        return self._facets

    def _posterior(self, points: Floats) -> dict[str, Floats]:
        """(T, 3, 2) in body sizes, right and up."""
        known: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(points), axis=2)
        facets: dict[str, Floats] = {}
        if known.all(axis=1).sum() >= FEWEST_INSTANTS:
            facets["shape_horizontal"] = three_ways(spreading(points, self._rate_hz))
        if (known[:, :2].any(axis=1) & known[:, 2]).sum() >= FEWEST_INSTANTS:
            facets["shape_vertical"] = three_ways(rising(points, self._rate_hz))
            if abs(self._depth) >= LEAST_DEPTH:
                facets["shape_sagittal"] = three_ways(advancing(points, self._rate_hz, back=0) / self._depth)
        return facets


def triangle(tracks: Floats) -> Floats:
    """(T, 3, D) two hands and the face -> (T,) the area between them, in body sizes squared."""
    left, right = tracks[:, 0] - tracks[:, 2], tracks[:, 1] - tracks[:, 2]
    squares = (left**2).sum(axis=1) * (right**2).sum(axis=1) - (left * right).sum(axis=1) ** 2
    area: Floats = np.sqrt(np.maximum(squares, 0.0)) / 2
    return area


def spreading(tracks: Floats, rate_hz: float) -> float:
    """(T, 3, D) -> mean rate of √area, body sizes a second: positive spreads, negative encloses."""
    return _rate(np.sqrt(triangle(tracks)), rate_hz)


def rising(tracks: Floats, rate_hz: float) -> float:
    """(T, 3, D) -> mean rate of the hands' height (axis 1) against the face, body sizes a second."""
    return _rate(_hands_against_face(tracks[:, :, 1]), rate_hz)


def advancing(tracks: Floats, rate_hz: float, back: int = 2) -> float:
    """(T, 3, D) -> mean rate of the hands' way forward of the face, body sizes a second; axis `back` is backwards."""
    return -_rate(_hands_against_face(tracks[:, :, back]), rate_hz)


def _hands_against_face(places: Floats) -> Floats:
    """(T, 3) -> (T,) mean of the visible hands, relative to the face."""
    hands = places[:, :2]
    known = np.isfinite(hands)
    count = known.sum(axis=1)
    mean = np.where(count > 0, np.where(known, hands, 0.0).sum(axis=1) / np.maximum(count, 1), np.nan)
    return mean - places[:, 2]


def _rate(values: Floats, rate_hz: float) -> float:
    """(T,) -> slope per second of the regression line through all values that are not NaN; 0 with fewer than two."""
    known = np.isfinite(values)
    if known.sum() < 2:
        return 0.0
    t = np.flatnonzero(known) / rate_hz
    t = t - t.mean()
    return float(t @ values[known] / (t @ t))


def three_ways(rate: float) -> Floats:
    """A rate in body sizes a second -> (3,) P(shrinks), P(neither), P(grows), in the order of the facets' values."""
    shrinks, grows = _normal((-rate - SLOW_SHAPE_PER_S) / NOISE), _normal((rate - SLOW_SHAPE_PER_S) / NOISE)
    return np.array([shrinks, max(1.0 - shrinks - grows, 0.0), grows])


def depth_in(matrix: Floats) -> float:
    """(3, 4) projective matrix -> cosine of the picture's right and the performer's back, -1 to 1; 0 for the Door."""
    return float(picture_right(matrix)[2])


def _normal(x: float) -> float:
    return 0.5 * math.erfc(-x / math.sqrt(2.0))


class FacetReader:
    """Reads all facets of an observer: Shape always, Effort if there is a model of it."""

    def __init__(
        self, body_parts: Sequence[str], rate_hz: float, depth: float = 0.0, effort: EffortModel | None = None
    ) -> None:
        self._shape = ShapeReader(body_parts, rate_hz, depth)
        self._effort = None if effort is None else EffortReader(effort, body_parts, rate_hz)
        self.facets: Mapping[str, Floats] = {}

    def update(self, tracks: Tracks, rest: float, read: bool = True) -> None:
        """One frame, and the probability of rest in it; the result is left in `facets`.

        read: whether it is read, or another frame follows at once.
        """
        effort = {} if self._effort is None else self._effort.update(tracks, rest)
        self.facets = {**effort, **self._shape.update(tracks.centres, read)}
