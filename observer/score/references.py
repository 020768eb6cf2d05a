"""Reference takes of one movement as one view sees them, and the score of a performance against them. Pure.

The spread of the references among themselves is the unit: each is compared with those of other people (or, of one
person, with the other takes), exactly as a performance is later (docs/design/score.md).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from common.errors import BadInput
from common.score import LEAST_REFERENCES
from common.text import plural
from observer.model.nearest_take import USUAL_DISTANCE
from observer.score.alignment import Align, Alignment
from observer.score.deviations import columns_of, deviations, weights_of
from observer.score.limbs import Limb, angles_of, joints_of, limbs_of, places_of
from observer.score.remarks import OWN_TOLERANCE, TOLERANCE, Band, Remark, largest, remarks_of
from observer.tracks import Floats, Floats32

BAND = 8
"""Takes nearest to a performance that make the reference band."""
BEST, HALF = 10.0, 0.5
"""The score of a typical reference, and what is left of it where the deviations are one spread larger on average: about
as in the worst of 40 references of UI-PRMD (1.06, the median over exercises, views and people left out; .5 to 2.5, so
that the worst itself, a single take, would be no unit)."""
FAR = 3.0
"""Times the distance of the farthest reference from the others, but at least what takes of one movement usually differ
by: what is farther is another movement."""
LEAST_SEEN = 2 / 3
"""Share of the limbs that has to be seen."""
LEAST_FARTHEST = 1e-6


@dataclass(frozen=True, slots=True)
class ReferenceTake:
    """A trace (F, 2 P + 3) of one take, and who did it. mirrored: as they would do it to the other side."""

    trace: Floats32
    person: str
    mirrored: bool = False


class ReferenceSpread(NamedTuple):
    """How much the references differ among themselves, each compared as a performance is.

    usual, spread (R,): mean and deviation of R deviations. farthest: distance of a reference from the nearest other
    one. typical: the badness of half of them. remarked (J,): see `largest`.
    """

    usual: Floats
    spread: Floats
    farthest: float
    typical: float
    remarked: Floats


@dataclass(frozen=True, slots=True)
class JudgeScore:
    """What one judge says: score 0 to 10, None if `uncertain` says why not; by limb, how many spreads it is off.

    certainty: share of the limbs that was seen, 0 to 1. band: the references and the performance, for a figure.
    """

    score: float | None
    certainty: float = 0.0
    remarks: tuple[Remark, ...] = ()
    limbs: tuple[tuple[str, float], ...] = ()
    band: Band | None = None
    uncertain: str = ""


class ReferenceTakes:
    """The references of one movement for one view. Raises BadInput for fewer than LEAST_REFERENCES.

    spread: as measured earlier; measuring takes as long as judging each of the takes. align: for who aligns the same
    takes again and again, with some of them left out.
    """

    def __init__(
        self,
        takes: Sequence[ReferenceTake],
        body_parts: Sequence[str],
        rate_hz: float,
        spread: ReferenceSpread | None = None,
        align: Align = Alignment,
    ) -> None:
        own = [n for n, take in enumerate(takes) if not take.mirrored]
        if len(own) < LEAST_REFERENCES:
            raise BadInput(
                f"{plural(len(own), 'reference take')}: a score needs at least {LEAST_REFERENCES}, because their "
                "differences are its unit"
            )
        self.takes = tuple(takes)
        self._limbs, self._joints, self._rate_hz = limbs_of(body_parts), joints_of(body_parts), rate_hz
        self._align = align
        self._places = [places_of(take.trace) for take in takes]
        self._people = np.array([take.person for take in takes])
        columns = columns_of(self._limbs, self._joints)
        self._weights, self._limb_of = weights_of(columns), np.array([limb for _, limb in columns])
        self.spread = spread or self._measured(own)

    @property
    def count(self) -> int:
        """How many takes there are, those to the other side not counted."""
        return sum(not take.mirrored for take in self.takes)

    def _measured(self, own: Sequence[int]) -> ReferenceSpread:
        compared = [self._compare(self._places[n], self._others(n)) for n in own]
        rows = np.array([row for row, *_ in compared])
        farthest = max(distance for *_, distance in compared)
        usual, spread = rows.mean(axis=0), rows.std(axis=0) + LEAST_FARTHEST
        badness = self._weights @ np.maximum((rows - usual) / spread, 0.0).T
        is_one = len({*self._people.tolist()}) == 1
        remarked = largest([band for _, band, _ in compared], OWN_TOLERANCE if is_one else TOLERANCE)
        return ReferenceSpread(usual, spread, farthest, float(np.median(badness)), remarked)

    def _others(self, take: int) -> list[int]:
        """Those of other people; of one person, the other takes."""
        others = np.flatnonzero(self._people != self._people[take])
        enough = others if len(others) >= LEAST_REFERENCES - 1 else np.arange(len(self._people))
        return [int(n) for n in enough if n != take]

    def judge(self, trace: Floats32, seen: Sequence[bool] | None = None) -> JudgeScore:
        """JudgeScore a performance: (F, 2 P + 3) its trace. seen: (P,) which parts were mostly seen; None: all."""
        certainty = self._seen_share(seen)
        if certainty < LEAST_SEEN:
            unseen = ", ".join(limb.name for limb in self._limbs if not _is_seen(limb, seen))
            return JudgeScore(None, certainty, uncertain=f"too little is seen: not the {unseen}")
        if len(trace) < 2:
            return JudgeScore(None, certainty, uncertain="the performance has no two frames")
        row, band, distance = self._compare(places_of(trace), range(len(self._places)))
        if distance > max(FAR * self.spread.farthest, USUAL_DISTANCE):
            times = distance / max(self.spread.farthest, LEAST_FARTHEST)
            far = f"{times:.0f} times as far from the references as any of them"
            return JudgeScore(None, certainty, uncertain=f"this is another movement: {far}")
        off = self._spreads(row)
        limbs = tuple((limb.name, float(off[self._limb_of == limb.name].mean())) for limb in self._limbs)
        remarks = remarks_of(band, self.spread.remarked)
        return JudgeScore(self._score(float(self._weights @ off)), certainty, remarks, limbs, band)

    def _compare(self, places: Floats32, others: Sequence[int]) -> tuple[Floats, Band, float]:
        """Deviations from the nearest of the others and its distance; the band of the BAND nearest."""
        alignment = self._align(places, [self._places[n] for n in others])
        near = np.argsort(alignment.distances)[:BAND]
        paths = [alignment.path(int(k)) for k in near]
        shown = [self._places[others[int(k)]] for k in near]
        angles = [angles_of(each, self._joints) for each in shown]
        band = Band.of(angles_of(places, self._joints), angles, paths, self._joints)
        row = deviations(places, shown[0], paths[0], self._rate_hz, self._limbs, band.ranges)
        return row, band, float(alignment.distances.min())

    def _spreads(self, row: Floats) -> Floats:
        """Deviations in spreads of the references; less than usual is no merit."""
        return np.maximum((row - self.spread.usual) / self.spread.spread, 0.0)

    def _score(self, badness: float) -> float:
        return float(BEST * HALF ** max(badness - self.spread.typical, 0.0))

    def _seen_share(self, seen: Sequence[bool] | None) -> float:
        return sum(_is_seen(limb, seen) for limb in self._limbs) / len(self._limbs) if self._limbs else 0.0


def _is_seen(limb: Limb, seen: Sequence[bool] | None) -> bool:
    return seen is None or all(seen[part] for part in limb.parts)
