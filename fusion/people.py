"""Who is who among cameras: the tracks of all observers of a scene become its people. Pure: time is passed in.

The design: people.md. Places are (2,) x and z on the floor in metres, covariances (2, 2) in m².

1. An observer's track is of one person for as long as it lives: observers give a new id where they may have exchanged
   two people. So a track keeps its person unless the places of the others speak clearly against it.
2. The tracks of one observer are of different people: the matching with the least total cost counts.
3. A track that fits nobody for `BEGIN_S` begins a person, if the scene has one free, or has one whom one observer alone
   sees and two see this one.
4. A person whom no track shows for `GONE_S` has left. Until then they are expected where they were going. Who is
   `kept`, because they lie, has not left: they are expected where they were.
"""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from common import SECOND_NS
from common.floor_place import BODY_SPREAD_M, KEEP, PERSON_GATE, FloorPlace, best_matching
from common.probability import Floats
from fusion.person_motion import Motion

AGREE_S = 0.5
"""Costs are averaged over so long: the errors of a camera's pictures last as long as a step of a person who walks."""
TRACK_FRESH_S = 0.4
"""A track that has not been seen for so long is not compared."""
BEGIN_S, GONE_S = 0.3, 2.0


@dataclass(frozen=True, slots=True)
class SeenTrack:
    """Where an observer saw the person of one of its tracks, at a time of the fusion machine's clock."""

    observer: str
    track: str
    place: FloorPlace
    at_ns: int

    @property
    def at(self) -> Floats:
        """(2,) x and z on the floor, metres."""
        return np.array(self.place.at)

    @property
    def covariance(self) -> Floats:
        """(2, 2) m², of the tracking and of what cameras differ by about one body."""
        xx, xz, zz = self.place.covariance
        return np.array([[xx + BODY_SPREAD_M**2, xz], [xz, zz + BODY_SPREAD_M**2]])


@dataclass(slots=True)
class _Track:
    """A track of one observer. since_ns: since when it has no person. costs: by person, the mean over AGREE_S.

    before_ns: the time of its last sighting but one; all sightings of that picture have arrived. is_new: whether its
    newest sighting has not been compared yet. fits: whether it may be of a known person.
    """

    seen: SeenTrack
    since_ns: int
    before_ns: int = 0
    person: str | None = None
    costs: dict[str, float] = field(default_factory=dict)
    compared_ns: int = 0
    is_new: bool = True
    fits: bool = False

    @property
    def waits(self) -> bool:
        """Whether it has no person, and fits none who is known."""
        return self.person is None and not self.fits


class ScenePeople:
    """The people of a scene. ids: of at most so many people, in the order in which they are given."""

    def __init__(self, ids: Sequence[str]) -> None:
        self.ids = tuple(ids)
        self._people: dict[str, Motion] = {}
        self._tracks: dict[tuple[str, str], _Track] = {}
        self.kept: frozenset[str] = frozenset()

    @property
    def present(self) -> Sequence[str]:
        """The ids of those who are there."""
        return [person for person in self.ids if person in self._people]

    def place(self, person: str, now_ns: int) -> tuple[float, float] | None:
        """x and z where they are, or are expected; None if they are not there."""
        motion = self._people.get(person)
        if motion is None:
            return None
        x, z = motion.expected(now_ns)[0].tolist()
        return x, z

    def person_of(self, observer: str, track: str) -> str | None:
        """Whose track it is; None if that is not known."""
        known = self._tracks.get((observer, track))
        return None if known is None else known.person

    def update(self, sightings: Sequence[SeenTrack], now_ns: int) -> None:
        """Take in what observers saw since the last update."""
        for sighting in sorted(sightings, key=lambda each: each.at_ns):
            key = sighting.observer, sighting.track
            if (track := self._tracks.get(key)) is None:
                self._tracks[key] = _Track(sighting, sighting.at_ns)
            elif sighting.at_ns > track.seen.at_ns:
                track.before_ns, track.seen, track.is_new = track.seen.at_ns, sighting, True
        for observer in dict.fromkeys(sighting.observer for sighting in sightings):
            self._match(observer, now_ns)
        self._forget(now_ns)
        self._begin(now_ns)

    def align(self, places: Mapping[str, Sequence[float]], at_ns: int) -> None:
        """Take over the ids of another service, which has people at these places; one unknown here is expected there.

        To be called while this service does not publish: ids change.
        """
        ids = [person for person in places if person in self.ids]
        own = self.present
        costs = [
            [
                _cost(np.array(places[person]), np.eye(2) * BODY_SPREAD_M**2, *self._people[mine].expected(at_ns))
                for mine in own
            ]
            for person in ids
        ]
        renamed = {own[column]: ids[row] for row, column in best_matching(costs, PERSON_GATE / 2)[1].items()}
        if any(old != new for old, new in renamed.items()):
            free = [person for person in self.ids if person not in renamed.values()]
            renamed |= {mine: free.pop(0) for mine in own if mine not in renamed}
            self._people = {renamed[mine]: motion for mine, motion in self._people.items()}
            for track in self._tracks.values():
                track.person, track.costs = renamed.get(track.person or ""), {}
        for person in ids:
            if person not in self._people:
                self._people[person] = Motion(np.array(places[person]), np.eye(2) * 4 * BODY_SPREAD_M**2, at_ns)

    def _match(self, observer: str, now_ns: int) -> None:
        """Decide whose the tracks of one observer are, and move those people."""
        tracks = [each for each in self._fresh(now_ns) if each.seen.observer == observer]
        people = self.present
        others = {person: self._estimate(person, observer, now_ns) for person in people}
        for track in tracks:
            if track.is_new:
                _compare(track, others)
        # To leave the person that it has must be worth KEEP for a track.
        costs = [[t.costs.get(person, math.inf) - KEEP * (person == t.person) for person in people] for t in tracks]
        total, matching = best_matching(costs, PERSON_GATE / 2)
        for row, track in enumerate(tracks):
            person = people[matching[row]] if row in matching else None
            track.fits = person is not None
            if person is not None and track.person is None and not _is_sure(track, costs, row, matching[row], total):
                person = None
            if person is None and track.person is not None:
                track.since_ns = track.seen.at_ns
            track.person = person
            if person is not None and track.is_new:
                self._people[person].update(track.seen.at, track.seen.covariance, track.seen.at_ns)
            track.is_new = False

    def _given_up(self, due: Sequence[_Track], now_ns: int) -> list[str]:
        """The person who gives up their id to a track that waits, as one observer alone sees them; [] if nobody does.

        Only if two observers see the same person wait: one observer, which may invent people, keeps nobody out.
        """
        confirmed = any(
            one.seen.observer != other.seen.observer
            and _cost(one.seen.at, one.seen.covariance, other.seen.at, other.seen.covariance) < PERSON_GATE / 2
            for one, other in itertools.combinations(due, 2)
        )
        observers = {
            person: {t.seen.observer for t in self._fresh(now_ns) if t.person == person} for person in self.ids
        }
        given_up = next((person for person, seen_by in observers.items() if len(seen_by) < 2), None)
        if not confirmed or given_up is None:
            return []
        for track in self._tracks.values():
            if track.person == given_up:
                track.person, track.since_ns = None, track.seen.at_ns
        return [given_up]

    def _estimate(self, person: str, observer: str, now_ns: int) -> tuple[Floats, Floats]:
        """Where the other observers see the person now; if none does, where the person is expected."""
        seen = [
            track.seen
            for track in self._fresh(now_ns)
            if track.person == person and track.seen.observer != observer
        ]  # fmt: skip
        if not seen:
            return self._people[person].expected(now_ns)
        informations = [np.linalg.inv(each.covariance) for each in seen]
        covariance = np.linalg.inv(np.sum(informations, axis=0))
        at = covariance @ np.sum([i @ each.at for i, each in zip(informations, seen, strict=True)], axis=0)
        return at, covariance

    def _fresh(self, now_ns: int) -> Iterator[_Track]:
        return (track for track in self._tracks.values() if now_ns - track.seen.at_ns <= TRACK_FRESH_S * SECOND_NS)

    def _forget(self, now_ns: int) -> None:
        """Forget people and tracks that have not been seen for GONE_S, and all that is dated far ahead."""
        gone_ns = GONE_S * SECOND_NS
        for person in self.kept & self._people.keys():
            if now_ns - self._people[person].seen_ns > TRACK_FRESH_S * SECOND_NS:
                at, _ = self._people[person].expected(self._people[person].seen_ns)
                self._people[person] = Motion(at, np.eye(2) * 4 * BODY_SPREAD_M**2, now_ns)
        self._people = {p: m for p, m in self._people.items() if abs(now_ns - m.seen_ns) <= gone_ns}
        self._tracks = {key: t for key, t in self._tracks.items() if abs(now_ns - t.seen.at_ns) <= gone_ns}
        for track in self._tracks.values():
            if track.person not in self._people:
                track.person = None

    def _begin(self, now_ns: int) -> None:
        """Begin people for tracks that fit nobody; those that come together from left to right, seen from yaw:0."""
        due = [t for t in self._fresh(now_ns) if t.waits and t.before_ns - t.since_ns >= BEGIN_S * SECOND_NS]
        if not due:
            return
        # All of one picture, so that of two who come together none is first by chance; others' may be the same people.
        observer, seen_ns = due[0].seen.observer, due[0].before_ns
        together = [
            t
            for t in self._tracks.values()
            if t.waits and t.seen.observer == observer and t.seen.at_ns >= max(seen_ns, t.since_ns + 1)
        ]
        free = [person for person in self.ids if person not in self._people] or self._given_up(due, now_ns)
        for track, person in zip(sorted(together, key=lambda t: -t.seen.place.at[0]), free, strict=False):
            self._people[person] = Motion(track.seen.at, track.seen.covariance, track.seen.at_ns)
            for other in self._tracks.values():
                # Those are of somebody who had this id before. Until it is compared, each may be of the new one.
                other.costs.pop(person, None)
                other.fits = True
            track.person, track.costs = person, {person: 0.0}


def _is_sure(track: _Track, costs: Sequence[Sequence[float]], row: int, column: int, total: float) -> bool:
    """Whether a track that had nobody is of the person of `column`: any other matching is worse by KEEP; or it has
    waited for that as long as costs are averaged."""
    if track.seen.at_ns - track.since_ns >= AGREE_S * SECOND_NS:
        return True
    without = [list(each) for each in costs]
    without[row][column] = math.inf
    return best_matching(without, PERSON_GATE / 2)[0] - total >= KEEP


def _compare(track: _Track, others: Mapping[str, tuple[Floats, Floats]]) -> None:
    """Update the costs of a track that has been seen since they were computed."""
    seen = track.seen
    kept = math.exp(-(seen.at_ns - track.compared_ns) / SECOND_NS / AGREE_S)
    costs = {}
    for person, (at, covariance) in others.items():
        # A track that is far away is no more wrong than one outside the gate, so that it can come back.
        cost = min(_cost(seen.at, seen.covariance, at, covariance), PERSON_GATE)
        costs[person] = kept * track.costs.get(person, cost) + (1 - kept) * cost
    track.costs, track.compared_ns = costs, seen.at_ns


def _cost(at: Floats, covariance: Floats, other: Floats, other_covariance: Floats) -> float:
    """Half the squared Mahalanobis distance of two places, nats."""
    apart = at - other
    return float(apart @ np.linalg.solve(covariance + other_covariance, apart)) / 2
