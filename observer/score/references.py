"""Reference takes of one movement as one view sees them, and the score of a performance against them. Pure.

The spread of the references among themselves is the unit: each is compared with those of other people (or, of one
person, with the other takes), exactly as a performance is later (docs/design/score.md).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from common.errors import BadInput
from common.score import LEAST_REFERENCES, REMARKS_LIMIT, remark_words
from common.text import plural
from observer.model.nearest_take import USUAL_DISTANCE
from observer.score.comparison import (
    Align,
    Alignment,
    LimbJoint,
    angles_of,
    deviations,
    joints_of,
    limbs_of,
    places_of,
    weights_of,
)
from observer.tracks import Floats, Floats32, Integers

POINTS = 20
"""Moments of a performance at which joints are compared, 5 % apart: each the mean of what is nearest to it."""
QUARTERS = 4
"""Of a movement: over each the angles are averaged before a joint is remarked, because noise and a moment's delay at a
turning point are no error."""
LEAST_DEGREES = 8.0
"""A tracker's noise of one angle, and what people hardly see."""
TOLERANCE, OWN_TOLERANCE = 1.5, 2.2
"""Times what the farthest reference is off, where they are of several people, and where they are of one: people vary
more from day to day than within the few takes of one. On UI-PRMD nine of ten unchanged takes then have no remark."""


@dataclass(frozen=True, slots=True)
class Remark:
    """`left knee: 12 degrees too straight at 60 %`. moment: 0 to 1; degrees: more than 0 is too straight.
    strength: over the limit at which a joint is remarked."""

    joint: str
    limb: str
    moment: float
    degrees: float
    strength: float = 1.0

    @property
    def words(self) -> str:
        """The line of text."""
        return remark_words(self.joint, self.degrees, self.moment)


@dataclass(frozen=True, slots=True)
class Band:
    """Angles of J joints at POINTS moments, degrees: the performance, and mean and deviation of the references.

    ranges: (2, J) degrees, how far the joints of the performance go, and those of the first reference.
    """

    joints: tuple[LimbJoint, ...]
    own: Floats
    mean: Floats
    deviation: Floats
    ranges: Floats

    @classmethod
    def of(cls, own: Floats, shown: Sequence[Floats], paths: Sequence[Integers], joints: Sequence[LimbJoint]) -> "Band":
        """own: (F, J); shown: of each reference (G, J); paths: the frames that belong together."""
        moments = np.arange(len(own)) * (POINTS / len(own))
        place = np.minimum(moments.astype(int), POINTS - 1)
        aligned = [each[path[:, 1]] for each, path in zip(shown, paths, strict=True)]
        sampled = np.array([_means(place[path[:, 0]], each) for path, each in zip(paths, aligned, strict=True)])
        at_moments = _means(place, own)
        ranges = np.ptp([at_moments, sampled[0]], axis=1)
        return cls(tuple(joints), at_moments, sampled.mean(axis=0), sampled.std(axis=0), ranges)

    @property
    def spreads(self) -> Floats:
        """(POINTS, J) how many deviations the performance is above the references, at least LEAST_DEGREES each."""
        return (self.own - self.mean) / np.maximum(self.deviation, LEAST_DEGREES)


def _means(place: Integers, values: Floats) -> Floats:
    """(POINTS, J) means of the values (L, J) at each place; the one before where there is none."""
    sums, counts = np.zeros((POINTS, values.shape[1])), np.bincount(place, minlength=POINTS)
    np.add.at(sums, place, values)
    known = np.maximum.accumulate(np.where(counts > 0, np.arange(POINTS), 0))
    return sums[known] / np.maximum(counts[known], 1)[:, None]


def _strength(band: Band) -> Floats:
    """(J,) how far each joint is off over the whole movement: root mean square over quarters of its mean spreads."""
    means = band.spreads.reshape(QUARTERS, POINTS // QUARTERS, -1).mean(axis=1)
    strength: Floats = np.sqrt((means**2).mean(axis=0))
    return strength


def largest(bands: Sequence[Band], tolerance: float = TOLERANCE) -> Floats:
    """(J,) the strength at which a joint is remarked: more than any reference has, each against the others."""
    strengths = np.array([_strength(band) for band in bands])
    if not strengths.size:
        return np.zeros(strengths.shape[1] if strengths.ndim > 1 else 0)
    usual = strengths.mean(axis=0) + 1e-6
    # One limit for all joints together, so that many joints do not mean many remarks.
    limits: Floats = tolerance * usual * float((strengths / usual).max())
    return limits


def remarks_of(band: Band, limits: Floats) -> tuple[Remark, ...]:
    """At most REMARKS_LIMIT, the strongest first: joints that are farther off than references are."""
    if not len(limits):
        return ()
    ratio = _strength(band) / limits
    remarks = list[Remark]()
    for n in np.argsort(-ratio):
        if ratio[n] <= 1.0 or len(remarks) == REMARKS_LIMIT:
            break
        at = int(np.abs(band.spreads[:, n]).argmax())
        degrees = float(band.own[at, n] - band.mean[at, n])
        joint = band.joints[n]
        if abs(degrees) < LEAST_DEGREES:
            continue
        remarks.append(Remark(joint.name, joint.limb, (at + 0.5) / POINTS, degrees, float(ratio[n])))
    return tuple(remarks)


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
    """What one judge says: score 0 to 10, None if `uncertain` says why not.

    certainty: share of the limbs that was seen, 0 to 1. band: the references and the performance, for a figure.
    """

    score: float | None
    certainty: float = 0.0
    remarks: tuple[Remark, ...] = ()
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
        self._weights = weights_of(self._limbs, self._joints)
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
        """Score a performance: (F, 2 P + 3) its trace. seen: (P,) which parts were mostly seen; None: all."""
        unseen = [limb.name for limb in self._limbs if seen is not None and not all(seen[part] for part in limb.parts)]
        certainty = (len(self._limbs) - len(unseen)) / len(self._limbs) if self._limbs else 0.0
        if certainty < LEAST_SEEN:
            return JudgeScore(None, certainty, uncertain=f"too little is seen: not the {', '.join(unseen)}")
        if len(trace) < 2:
            return JudgeScore(None, certainty, uncertain="the performance has no two frames")
        row, band, distance = self._compare(places_of(trace), range(len(self._places)))
        if distance > max(FAR * self.spread.farthest, USUAL_DISTANCE):
            times = distance / max(self.spread.farthest, LEAST_FARTHEST)
            far = f"{times:.0f} times as far from the references as any of them"
            return JudgeScore(None, certainty, uncertain=f"this is another movement: {far}")
        # Less than usual is no merit.
        off = np.maximum((row - self.spread.usual) / self.spread.spread, 0.0)
        score = float(BEST * HALF ** max(float(self._weights @ off) - self.spread.typical, 0.0))
        remarks = remarks_of(band, self.spread.remarked)
        return JudgeScore(score, certainty, remarks, band)

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
