"""An observer that follows several people: for each one `Observer`, which share the model's arrays.

A person costs one more update of the model. Whoever has a new id begins anew, because the belief of before may be of
somebody else.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from common.floor_place import FloorPlace
from observer.geometry.placement import HEAD_M, PersonPlacement, floor_place
from observer.geometry.views import View
from observer.prepared_tracks import PreparedTracker
from observer.runtime.pipeline import Observer, Posterior
from observer.tracks import Floats, Frame, PersonTracks, Tracker, Tracks

BODY_HEIGHT_M = 1.7
"""Height of a person whose distance from a camera of unknown place follows from their size in its picture."""
USUAL_FOCAL_PX = 1000.0
"""The focal length of tracks without a picture, in their unit: only changes of their size matter."""
SIZE_SPREAD, ASIDE_M = 0.15, 0.1
"""Standard deviations of that distance, as a share, and of the place to the side."""


class FloorPlacer:
    """Tells where a person is. alone: no other camera looks, so that any axes will do; else the view's."""

    def __init__(self, view: View, person: PersonPlacement | None, *, alone: bool) -> None:
        self._view, self._placement, self._alone = view, person or PersonPlacement(), alone

    def place(self, parts: Sequence[str], person: PersonTracks, width_px: int) -> FloorPlace | None:
        """The place of a person whose `every` are these parts, in a picture of this width; None if it is unknown."""
        if self._view.has_place and person.every is not None:
            head_m, expected = self._placement.head_m or HEAD_M, (self._placement.x_m, self._placement.z_m)
            gaussian = floor_place(self._view.matrix, parts, person.every, head_m, expected)
            if gaussian is None:
                return None
            (x, z), covariance = gaussian
            xx, xz, zz = float(covariance[0, 0]), float(covariance[0, 1]), float(covariance[1, 1])
            return FloorPlace(at=(float(x), float(z)), covariance=(xx, xz, zz))
        return _by_size(person, width_px) if self._alone else None


def _by_size(person: PersonTracks, width_px: int) -> FloorPlace:
    """A person's place before a camera at (0, 0) that looks along z with a field of view of 53 degrees; x is left."""
    focal_px = float(width_px or USUAL_FOCAL_PX)
    z = focal_px * BODY_HEIGHT_M / person.height
    tangent = (width_px / 2 - person.u) / focal_px
    along = (SIZE_SPREAD * z) ** 2
    xx, xz, zz = along * tangent**2 + ASIDE_M**2, along * tangent, along + ASIDE_M**2
    return FloorPlace(at=(tangent * z, z), covariance=(xx, xz, zz))


class _GivenTracks:
    """A `Tracker` that finds what it is given, of the parts that `prepared` selects."""

    def __init__(self, prepared: PreparedTracker) -> None:
        self._prepared = prepared
        self.given: Floats | None = None

    @property
    def body_parts(self) -> Sequence[str]:
        """The parts that the model reads."""
        return self._prepared.body_parts

    def update(self, frame: Frame) -> Tracks:
        """What was given, or nothing."""
        return Tracks(np.full((len(self.body_parts), 2), np.nan) if self.given is None else self.given)


class PeopleObserver:
    """An `ObserverLike` for several people. new_observer: makes the `Observer` of one person from a tracker."""

    def __init__(
        self, tracker: PreparedTracker, new_observer: Callable[[Tracker], Observer], placer: FloorPlacer
    ) -> None:
        self._tracker, self._new_observer, self._placer = tracker, new_observer, placer
        self._nobody = new_observer(_GivenTracks(tracker))
        self._people: dict[int, tuple[_GivenTracks, Observer]] = {}
        first = self._nobody
        self.vocabulary, self.body_parts, self.leans_on = first.vocabulary, first.body_parts, first.leans_on
        self.tracks: Tracks | None = None

    @property
    def complaint(self) -> str:
        """As of `Observer`."""
        return self._tracker.complaint

    def step(self, frame: Frame) -> Posterior:
        """The posterior of the first person, with those of the others, after one more frame; of nobody without any."""
        if self.tracks is None or not frame.repeated:
            self.tracks = self._tracker.update(frame)
        persons = self._tracker.persons()
        self._people = {p.id: self._people.get(p.id) or self._new() for p in persons}
        if not persons:
            return self._nobody.step(frame)
        first, *others = [self._posterior(person, frame) for person in persons]
        return replace(first, others=tuple(others))

    def end(self) -> Posterior | None:
        """End every person's movement with the source; returns the changed posteriors, None if none has changed."""
        ended = [
            replace(posterior, person=str(number))
            for number, (_, observer) in self._people.items()
            if (posterior := observer.end()) is not None
        ]
        if not ended:
            return None
        return replace(ended[0], others=tuple(ended[1:]))

    def _new(self) -> tuple[_GivenTracks, Observer]:
        tracker = _GivenTracks(self._tracker)
        return tracker, self._new_observer(tracker)

    def _posterior(self, person: PersonTracks, frame: Frame) -> Posterior:
        tracker, observer = self._people[person.id]
        tracker.given = person.centres
        place = self._placer.place(self._tracker.every_part, person, picture_width(frame))
        return replace(observer.step(frame), person=str(person.id), place=place)


def picture_width(frame: Frame) -> int:
    """In px; 0 for tracks without a picture."""
    return int(frame.content.shape[1]) if frame.content.dtype == np.uint8 else 0


AnyObserver = Observer | PeopleObserver
