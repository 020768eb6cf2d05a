"""Which of several people a lesson is of, in one observer, so that all cameras learn from the same one. Pure.

1. Until a teacher says where the one stands who is taught, as another camera sees it, that is the tracker's first one.
2. From then on it is the one who fits there, for as long as the tracker is sure who that is; then who fits again. What
   a teacher said a while ago counts no more: two people may have changed places.
3. Where nobody fits, or two do, or nobody knows the place any more, nobody is taught, unless one person alone is seen.
"""

import math
from collections.abc import Sequence

import numpy as np

from common.floor_place import KEEP, PERSON_GATE, FloorPlace
from common.teaching_messages import TeachRequest
from observer.prepared_tracks import PreparedTracker
from observer.runtime.people_observer import FloorPlacer
from observer.tracking.person_keeper import seen_people
from observer.tracks import PersonTracks, Tracks

UNSURE_WHOM = (
    "several people are seen, and it is not sure who is taught: step apart, or send the others away for a moment"
)
PLACE_FRESH_S = 0.6
"""A place counts for so long: three looks of a teacher, in which somebody who walks goes half a metre."""


class TaughtPerson:
    """The person from whom one observer learns. place: where that person stands; None: not known.

    complaint: why nobody is taught; "" if all is well. is_begun: whether a take was begun since the last lesson.
    """

    def __init__(self, placer: FloorPlacer) -> None:
        self._placer = placer
        self._expected: FloorPlace | None = None
        self._expected_s, self.is_begun = -math.inf, False
        self._id: int | None = None
        self.place: FloorPlace | None = None
        self.complaint = ""

    def expect(self, request: TeachRequest, now_s: float) -> None:
        """Take in what a teacher asks; with each take, and at each look before the first, the person is chosen anew."""
        if request.command == "leave":
            self._expected, self.is_begun, self._id = None, False, None
        elif request.command in ("status", "begin"):
            if request.place is not None:
                self._expected, self._expected_s = request.place.on_floor(), now_s
            self.is_begun |= request.command == "begin"
            if request.place is not None and (request.command == "begin" or not self.is_begun):
                self._id = None

    def tracks(self, tracker: PreparedTracker, width_px: int, now_s: float) -> Tracks | None:
        """What the tracker has found of this person; nothing while it is not sure who it is."""
        persons = tracker.persons()
        if not persons:
            self.place, self.complaint = None, ""
            return tracker.every_track
        places = [self._placer.place(tracker.every_part, person, width_px) for person in persons]
        chosen = self._choose(persons, places, now_s)
        if chosen is None:
            self._id, self.place, self.complaint = None, None, UNSURE_WHOM
            return Tracks(np.full((len(tracker.every_part), 2), np.nan), people=seen_people(persons))
        self._id, self.place, self.complaint = persons[chosen].id, places[chosen], ""
        # Outlines are those of the picture, as the tracker finds them.
        outlines = [] if tracker.all_tracks is None else list(tracker.all_tracks.persons)
        first = outlines.pop(chosen)
        every = persons[chosen].every
        return Tracks(persons[chosen].centres if every is None else every, people=seen_people([first, *outlines]))

    def _choose(self, persons: Sequence[PersonTracks], places: Sequence[FloorPlace | None], now_s: float) -> int | None:
        known = next((n for n, person in enumerate(persons) if person.id == self._id), None)
        if known is not None or self._expected is None:
            return known or 0
        if now_s - self._expected_s > PLACE_FRESH_S:
            return 0 if len(persons) == 1 else None
        costs = [math.inf if place is None else self._expected.distance(place) for place in places]
        best, *others = sorted(range(len(costs)), key=costs.__getitem__)
        is_alone = all(costs[other] - costs[best] >= KEEP for other in others)
        return best if costs[best] <= PERSON_GATE / 2 and is_alone else None
