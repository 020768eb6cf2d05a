"""Recordings of several people in one room, as a view sees them. Pure.

Their rows are those of person_keeper.py. The person nearer to the camera covers others: a part behind the trunk or the
head of somebody else is not seen.
"""

from collections.abc import Sequence

import numpy as np

from observer.geometry.projection import Floats, oriented, project
from observer.geometry.views import View
from observer.tracking.person_keeper import Detection, PersonKeeper, detection_of, rows_of_people, seen_people
from observer.tracks import Frame, Tracks

TRUNK_M, HEAD_M = 0.16, 0.12
"""Half the width of a trunk, as wide as half the shoulders of an adult; the radius of a head."""


class ProjectedPeople:
    """A tracker of the recorded people, of at most `most`; recorded: names of the rows of a frame's content."""

    def __init__(self, view: View, recorded: Sequence[str], most: int) -> None:
        self.body_parts, self._rows = rows_of_people(recorded)
        self._view, self._keeper, self.most = view, PersonKeeper(most), most

    def update(self, frame: Frame) -> Tracks:
        """The people whom the view shows."""
        people = [frame.content[rows] for rows in self._rows]
        bodies = [body for n, _ in enumerate(people) if (body := self._seen(people, n)) is not None]
        persons = self._keeper.update(bodies, frame.at_ns)
        nobody = np.full((len(self.body_parts), 2), np.nan)
        return Tracks(persons[0].centres if persons else nobody, people=seen_people(persons), persons=persons)

    def _seen(self, people: Sequence[Floats], n: int) -> Detection | None:
        """What is seen of one of them; None if that is too little."""
        centres = project(self._view.matrix, people[n])
        whole = centres[np.isfinite(centres).all(axis=1)]
        for m, other in enumerate(people):
            if m != n:
                centres[self._covered(people[n], centres, other)] = np.nan
        return detection_of(centres, whole)

    def _covered(self, own: Floats, centres: Floats, other: Floats) -> np.ndarray:
        """(P,) which parts are behind the trunk or the head of `other`."""
        trunk = [other[self.body_parts.index(part)] for part in ("neck", "pelvis", "head") if part in self.body_parts]
        axis = np.array(trunk)
        places = project(self._view.matrix, axis)
        known = np.isfinite(places).all(axis=1)
        if not known.any():
            return np.zeros(len(own), dtype=bool)
        H = oriented(self._view.matrix)
        depth, px = _depths(H, own, axis[known].mean(axis=0))
        behind = depth > 0
        near = _distance_to(centres, places[known]) < TRUNK_M * px
        return behind & near


def _depths(H: Floats, points: Floats, at: Floats) -> tuple[Floats, float]:
    """How much farther (P,) points are than `at`, along the way of looking; and px of a metre there."""
    axis = np.cross(H[0, :3], H[1, :3]) if not H[2, :3].any() else H[2, :3]
    looking = axis / np.linalg.norm(axis)
    w = float(H[2, :3] @ at + H[2, 3])
    across = H[0, :3] - (H[0, :3] @ looking) * looking
    return (points - at) @ looking, float(np.linalg.norm(across)) / w


def _distance_to(centres: Floats, places: Floats) -> Floats:
    """(P,) px from centres to the broken line through the places."""
    best = np.full(len(centres), np.inf)
    for begin, end in zip(places, [*places[1:], places[-1]], strict=True):
        along = end - begin
        share = np.clip(((centres - begin) @ along) / max(float(along @ along), 1e-12), 0.0, 1.0)
        gap = np.linalg.norm(centres - begin - share[:, None] * along, axis=1)
        best = np.fmin(best, gap)
    return best
