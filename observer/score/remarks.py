"""Remarks: which joint is bent too much or too little, when, and by how much, against the references. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.score import REMARKS_LIMIT, remark_words
from observer.score.limbs import LimbJoint
from observer.tracks import Floats, Integers

POINTS = 20
"""Moments of a performance at which joints are compared, 5 % apart: each the mean of what is nearest to it."""
LEAST_DEGREES = 8.0
"""A tracker's noise of one angle, and what people hardly see."""
REFERENCE_TOLERANCE = 1.5
"""Times what the farthest reference is off: people vary more from day to day than within the few takes of one."""


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
        """For people."""
        return remark_words(self.joint, self.degrees, self.moment)


@dataclass(frozen=True, slots=True)
class Band:
    """Angles of J joints at POINTS moments, degrees: the performance, and mean and deviation of the references."""

    joints: tuple[LimbJoint, ...]
    own: Floats
    mean: Floats
    deviation: Floats

    @classmethod
    def of(cls, own: Floats, shown: Sequence[Floats], paths: Sequence[Integers], joints: Sequence[LimbJoint]) -> "Band":
        """own: (F, J); shown: of each reference (G, J); paths: the frames that belong together."""
        moments = np.arange(len(own)) * (POINTS / len(own))
        place = np.minimum(moments.astype(int), POINTS - 1)
        aligned = [each[path[:, 1]] for each, path in zip(shown, paths, strict=True)]
        sampled = np.array([_means(place[path[:, 0]], each) for path, each in zip(paths, aligned, strict=True)])
        return cls(tuple(joints), _means(place, own), sampled.mean(axis=0), sampled.std(axis=0))

    @property
    def spreads(self) -> Floats:
        """(POINTS, J) how many deviations the performance is above the references, at least LEAST_DEGREES each."""
        apart: Floats = (self.own - self.mean) / np.maximum(self.deviation, LEAST_DEGREES)
        return apart


def _means(place: Integers, values: Floats) -> Floats:
    """(POINTS, J) means of the values (L, J) at each place; the one before where there is none."""
    sums, counts = np.zeros((POINTS, values.shape[1])), np.bincount(place, minlength=POINTS)
    np.add.at(sums, place, values)
    known = np.maximum.accumulate(np.where(counts > 0, np.arange(POINTS), 0))
    means: Floats = sums[known] / np.maximum(counts[known], 1)[:, None]
    return means


def _strength(band: Band) -> Floats:
    """(J,) how far each joint is off over the whole movement: the root mean square of its spreads."""
    strength: Floats = np.sqrt((band.spreads**2).mean(axis=0))
    return strength


def largest(bands: Sequence[Band]) -> Floats:
    """(J,) the strength at which a joint is remarked: more than any reference has, each against the others."""
    strengths = np.array([_strength(band) for band in bands])
    if not strengths.size:
        return np.zeros(strengths.shape[1] if strengths.ndim > 1 else 0)
    usual = strengths.mean(axis=0) + 1e-6
    # One limit for all joints together, so that many joints do not mean many remarks.
    limits: Floats = REFERENCE_TOLERANCE * usual * float((strengths / usual).max())
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
