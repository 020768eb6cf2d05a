"""Facets of the movement that goes on: Effort from its begin until now, Shape of its last half second. Pure.

The movement watch tells rest; a movement begins where rest ends, and Effort begins anew with it.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from common.errors import BadInput
from observer.effort.course import Course
from observer.effort.features import features
from observer.effort.model import EffortModel
from observer.effort.shape import ShapeReader
from observer.tracks import BODY_PARTS, Floats, Tracks

AT_REST, MOVING = 0.8, 0.5
"""Rest above the first ends a movement, below the second begins one; between them all stays as it is."""
BEFORE_S = 0.2
"""A watch is sure of a movement only when it has begun: this much of the time before belongs to it."""
JUDGED_HZ = 5.0
"""So often Effort is judged: its features are of whole seconds, and a fifth of the frames costs a fifth."""
SEEN_S = 0.4
"""Less of a movement says nothing of its Effort."""


class EffortReader:
    """P(E_q | the movement so far) for each Effort factor; nothing at rest.

    body_parts: names of the P parts in the tracks; rate_hz: theirs. Raises BadInput when hands or head are missing.
    """

    def __init__(self, model: EffortModel, body_parts: Sequence[str], rate_hz: float) -> None:
        missing = [part for part in BODY_PARTS if part not in body_parts]
        if missing:
            raise BadInput(f"Effort: needs {missing[0]}, the movement model reads {', '.join(body_parts)}")
        self._model, self._rate_hz = model, rate_hz
        self._rows = [list(body_parts).index(part) for part in BODY_PARTS]
        self._course = Course(BODY_PARTS, rate_hz)
        self._before = max(round(BEFORE_S * rate_hz), 1)
        self._every = max(round(rate_hz / JUDGED_HZ), 1)
        self._resting, self._since = True, 0
        self._facets: Mapping[str, Floats] = {}

    def update(self, tracks: Tracks, rest: float) -> Mapping[str, Floats]:
        """One frame, and the probability of rest in it -> facets effort_* so far, (2,) each; {}: nothing to say."""
        self._course.add(tracks.centres[self._rows])
        if self._resting and rest < MOVING:
            self._resting, self._since = False, 0
            self._course.begin(self._before)
        elif rest > AT_REST:
            self._resting, self._facets = True, {}
        if not self._resting:
            self._since += 1
            if self._since >= SEEN_S * self._rate_hz and self._since % self._every == 0:
                self._facets = self._judged()
        return self._facets

    def _judged(self) -> Mapping[str, Floats]:
        found = features(self._course)
        return self._model.posterior(found) if np.isfinite(found).any() else self._facets


class FacetReader:
    """All facets that an observer can say: Shape always, Effort where there is a model of it."""

    def __init__(
        self, body_parts: Sequence[str], rate_hz: float, depth: float = 0.0, effort: EffortModel | None = None
    ) -> None:
        self._shape = ShapeReader(body_parts, rate_hz, depth)
        self._effort = None if effort is None else EffortReader(effort, body_parts, rate_hz)
        self.facets: Mapping[str, Floats] = {}

    def update(self, tracks: Tracks, rest: float) -> None:
        """One frame at the rate given, and how probable rest is in it; leaves `facets`."""
        effort = {} if self._effort is None else self._effort.update(tracks, rest)
        self.facets = {**effort, **self._shape.update(tracks.centres)}
