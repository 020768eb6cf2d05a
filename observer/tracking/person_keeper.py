"""Keeps several people apart from picture to picture: each detection becomes a track with an id. Pure.

1. A detection belongs to the track whose body, moved on, it resembles most: all parts are compared, so that two people
   who pass each other differ by their limbs while their middles meet.
2. An id lives as long as the keeper is sure who it is. Where a body near another person jumps, or two could as well be
   exchanged, both are unsure and are not published. When they are apart again they have new ids.
3. A track that is not seen stays for `OTHER_S`, with no part visible.

Lengths are in heights of the person, as in people.py, whose numbers hold here too. Where a frame has rows of several
people, the first person's parts have their usual names, and the nth's are NAME@n.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from common import SECOND_NS
from common.matching import best_matching
from observer.tracking.people import GROWTH, MERGED, OTHER_S, SPEED, STEP, Body
from observer.tracks import Floats, PersonTracks, SeenPeople

JUMP = 0.1
"""Half of the parts of one who goes on are nearer to where they are expected: plus SPEED / 2 each second."""
ALIKE = 0.05
"""Two people could be exchanged if their bodies then fit this nearly as well."""
COMMON_PARTS = 3
"""Parts seen in both pictures from which two bodies are compared by their parts."""
SMOOTH_S = 0.15
"""The velocity of a body is the mean over so long."""


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """A body in one picture. centres: (P, 2) px, NaN where not seen. u, v, height: as of `PersonTracks`."""

    centres: Floats
    u: float
    v: float
    height: float


@dataclass(slots=True)
class _Followed:
    """A track. du, dv: px per second. unsure: with whom it may have been exchanged."""

    id: int
    body: Detection
    seen_ns: int
    du: float = 0.0
    dv: float = 0.0
    unsure: set[int] = field(default_factory=set)

    def moved(self, at_ns: int) -> tuple[float, float]:
        """How far it has gone since it was seen, px."""
        gone_s = min((at_ns - self.seen_ns) / SECOND_NS, OTHER_S)
        return self.du * gone_s, self.dv * gone_s

    def stride(self, at_ns: int) -> float:
        """Heights that half of the parts of one who goes on stay within, of where they are expected."""
        return JUMP + SPEED / 2 * (at_ns - self.seen_ns) / SECOND_NS

    def distance(self, other: "Detection | _Followed", at_ns: int) -> float:
        """Between the middles of the two bodies at `at_ns`, in heights of this one."""
        du, dv = self.moved(at_ns)
        u, v = (other.u, other.v) if isinstance(other, Detection) else other.place(at_ns)
        return math.hypot(self.body.u + du - u, self.body.v + dv - v) / self.body.height

    def place(self, at_ns: int) -> tuple[float, float]:
        """Where its middle is expected, px."""
        du, dv = self.moved(at_ns)
        return self.body.u + du, self.body.v + dv


class PersonKeeper:
    """Follows at most `most` people."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._tracks: list[_Followed] = []
        self._last_id = 0

    def update(self, detections: Sequence[Detection], at_ns: int) -> tuple[PersonTracks, ...]:
        """The people of whom the keeper is sure, in the order in which they came; at_ns: of the picture."""
        self._tracks = [t for t in self._tracks if 0 <= at_ns - t.seen_ns <= OTHER_S * SECOND_NS]
        costs = [[self._cost(track, body, at_ns) for body in detections] for track in self._tracks]
        # In how far people move in that time: who was hidden may be farther away than who was seen a moment ago.
        moved = [[cost / track.stride(at_ns) for cost in row] for track, row in zip(self._tracks, costs, strict=True)]
        alone = max([1.0, *(1.01 * cost for row in moved for cost in row if cost < math.inf)])
        matching = best_matching(moved, alone)[1] if detections else {}
        self._doubt(costs, matching, at_ns)
        free = [body for n, body in enumerate(detections) if n not in matching.values()]
        for row, column in matching.items():
            _take(self._tracks[row], detections[column], at_ns)
        if free:
            # Of whom nobody knows who it is there is nothing to remember.
            self._tracks = [t for t in self._tracks if t.seen_ns == at_ns or not t.unsure]
        for body in sorted(free, key=lambda each: -each.height)[: self._most - len(self._tracks)]:
            self._tracks.append(_Followed(self._new_id(), body, at_ns))
        self._settle(at_ns)
        return tuple(_shown(track, at_ns) for track in self._tracks if not track.unsure)

    def _cost(self, track: _Followed, body: Detection, at_ns: int) -> float:
        """Heights between a track and a body; infinite if they are not of one person."""
        reach = STEP + SPEED * (at_ns - track.seen_ns) / SECOND_NS
        ratio = track.body.height / body.height
        if not (1 / GROWTH <= ratio <= GROWTH) or track.distance(body, at_ns) > reach:
            return math.inf
        return _pose_distance(track, body, at_ns)

    def _doubt(self, costs: Sequence[Sequence[float]], matching: dict[int, int], at_ns: int) -> None:
        """Note who may have been exchanged in this picture (rule 2)."""
        for row, track in enumerate(self._tracks):
            near = [n for n, o in enumerate(self._tracks) if n != row and track.distance(o, at_ns) < MERGED]
            for other in near:
                if row in matching and other in matching:
                    own = costs[row][matching[row]] + costs[other][matching[other]]
                    exchanged = costs[row][matching[other]] + costs[other][matching[row]]
                    doubtful = exchanged < own + 2 * ALIKE
                else:
                    doubtful = row in matching and costs[row][matching[row]] > track.stride(at_ns)
                if doubtful:
                    track.unsure.add(self._tracks[other].id)
                    self._tracks[other].unsure.add(track.id)

    def _settle(self, at_ns: int) -> None:
        """Give new ids to those who are apart from all with whom they may have been exchanged."""
        known = {track.id: track for track in self._tracks}
        for track in self._tracks:
            others = [known[each] for each in track.unsure if each in known]
            is_seen = track.seen_ns == at_ns
            apart = all(o.seen_ns == at_ns and track.distance(o, at_ns) >= MERGED for o in others)
            if track.unsure and is_seen and apart:
                track.id, track.unsure = self._new_id(), set()

    def _new_id(self) -> int:
        self._last_id += 1
        return self._last_id


def seen_people(persons: Sequence[PersonTracks]) -> SeenPeople:
    """Frames around these people, of whom the first is the one whose tracks a recording keeps."""
    outlines = [Body(person.u, person.v, person.height).outline for person in persons]
    return SeenPeople(outlines[0] if outlines else None, tuple(outlines[1:]))


def _pose_distance(track: _Followed, body: Detection, at_ns: int) -> float:
    """Heights: the median over the parts that both show, or between the middles."""
    apart = body.centres - track.body.centres - np.array(track.moved(at_ns))
    distances = np.hypot(apart[:, 0], apart[:, 1])
    common = distances[np.isfinite(distances)]
    if len(common) < COMMON_PARTS:
        return track.distance(body, at_ns)
    return float(np.median(common)) / track.body.height


def _take(track: _Followed, body: Detection, at_ns: int) -> None:
    gone_s = max((at_ns - track.seen_ns) / SECOND_NS, 1e-3)
    share = 1.0 - math.exp(-gone_s / SMOOTH_S)
    track.du += share * ((body.u - track.body.u) / gone_s - track.du)
    track.dv += share * ((body.v - track.body.v) / gone_s - track.dv)
    track.body, track.seen_ns = body, at_ns


def _shown(track: _Followed, at_ns: int) -> PersonTracks:
    centres = track.body.centres if track.seen_ns == at_ns else np.full_like(track.body.centres, np.nan)
    return PersonTracks(track.id, centres, *track.place(at_ns), track.body.height)


MARK = "@"
TALL_EXTENTS = 1.15
"""A person is so much taller than what is between head and feet; as much shorter parts stand for a whole body."""
LEAST_PARTS = 3
"""Fewer parts are no person."""


def has_several(body_parts: Sequence[str]) -> bool:
    """Whether the parts are of several people."""
    return any(MARK in part for part in body_parts)


def of_people(body_parts: Sequence[str], most: int) -> tuple[str, ...]:
    """The names of these parts of `most` people."""
    return (*body_parts, *(f"{part}{MARK}{n}" for n in range(2, most + 1) for part in body_parts))


def rows_of_people(recorded: Sequence[str]) -> tuple[tuple[str, ...], list[list[int]]]:
    """The parts of one person, and each person's rows of these in a frame; raises KeyError if one lacks a part."""
    parts = tuple(part for part in recorded if MARK not in part)
    numbers = sorted({int(part.partition(MARK)[2]) for part in recorded if MARK in part})
    known = {part: row for row, part in enumerate(recorded)}
    names = [parts, *([f"{part}{MARK}{n}" for part in parts] for n in numbers)]
    return parts, [[known[part] for part in own] for own in names]


def detection_of(centres: Floats, whole: Floats) -> Detection | None:
    """A person whose parts are seen at `centres` (P, 2), NaN where not seen; None if fewer than `LEAST_PARTS` are seen.

    whole: (Q, 2) all parts, also those that are hidden; middle and height of the person follow from them.
    """
    if np.isfinite(centres).all(axis=1).sum() < LEAST_PARTS:
        return None
    u, v = (whole.min(axis=0) + whole.max(axis=0)) / 2
    return Detection(centres, float(u), float(v), TALL_EXTENTS * max(float(np.ptp(whole[:, 1])), 1e-9))
