"""Remarks: which joint is bent too much or too little, when, and by how much, against the references. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.score import REMARKS_LIMIT, remark_words
from observer.score.limbs import LimbJoint
from observer.tracks import Floats, Integers

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
