"""A plausible body inferred from hands and head: hips, shoulders, elbows, knees and feet; pure.

Axes are those of the archive: x to the performer's right, y up, z to the performer's back, who faces -z. Only the three
parts were recorded; the rest just has to look like a person who holds them there.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.tracks import BODY_PARTS, Floats

LEFT, RIGHT, HEAD = (BODY_PARTS.index(name) for name in ("left_hand", "right_hand", "head"))

# Segment lengths as shares of the height (Drillis and Contini 1966); hands end at the palm.
LEG, TRUNK, NECK, HALF_SHOULDERS, HALF_HIPS = 0.530, 0.288, 0.118, 0.115, 0.052
UPPER_ARM, FOREARM, THIGH, SHIN, ANKLE = 0.186, 0.200, 0.245, 0.246, 0.045
HEAD_CENTRE = LEG + TRUNK + NECK

USUAL_HEIGHT, SHORTEST, TALLEST = 1.72, 1.45, 1.95
HANGING_HAND_SHARE = 0.5
"""Distance of a hanging hand below the head, share of the height: .47 by the segments, .54 in MSR Action3D."""
LONGEST_STRIDE = 0.45
MOST_TWIST_RAD = 0.6


@dataclass(frozen=True, slots=True, eq=False)
class Stature:
    """Position and height of a standing performer: `head` (3,) the middle of the upright head, in metres."""

    head: Floats
    height: float

    @property
    def floor(self) -> float:
        """y of the floor."""
        return float(self.head[1]) - HEAD_CENTRE * self.height

    @property
    def middle(self) -> Floats:
        """(3,) the middle of the performer, at which a camera is aimed."""
        return np.array([self.head[0], self.floor + 0.56 * self.height, self.head[2]])


@dataclass(frozen=True, slots=True, eq=False)
class Arm:
    """Positions (3,) in metres; `hand` is the middle of the palm."""

    shoulder: Floats
    elbow: Floats
    hand: Floats

    @property
    def along(self) -> Floats:
        """(3,) unit vector from the elbow to the hand."""
        return _unit(self.hand - self.elbow, np.array([0.0, -1.0, 0.0]))


@dataclass(frozen=True, slots=True, eq=False)
class BodyPose:
    """Positions in metres. head: None when not seen. arms: left and right, None when the hand is not seen.

    spine: unit vector from the hips to the head. across: unit vector along the shoulders to the performer's right.
    shoulders, hips, knees, ankles: (2, 3), left then right.
    """

    head: Floats | None
    spine: Floats
    across: Floats
    chest: Floats
    shoulders: Floats
    arms: tuple[Arm | None, Arm | None]
    hips: Floats
    knees: Floats
    ankles: Floats


def stature(positions: NDArray[np.floating]) -> Stature:
    """(F, P, 3) positions of one performer -> the stature: median position of the head, at its 80 % quantile of height.

    The height is estimated from the lowest hanging hand, 1.45 to 1.95 m, or is 1.72 m when no hand hangs.
    """
    places = np.asarray(positions, dtype=np.float64)
    heads = places[:, HEAD][np.isfinite(places[:, HEAD]).all(axis=1)]
    if not len(heads):
        known = places[np.isfinite(places).all(axis=2)]
        heads = known + np.array([0.0, 0.6, 0.0]) if len(known) else np.zeros((1, 3))
    head = np.median(heads, axis=0)
    head[1] = np.quantile(heads[:, 1], 0.8)
    return Stature(head, _height(places))


def _height(places: Floats) -> float:
    below = (places[:, HEAD, None] - places[:, [LEFT, RIGHT]])[:, :, 1]
    below = below[np.isfinite(below)]
    furthest = float(np.quantile(below, 0.95)) if len(below) else 0.0
    # Hands that are never lowered do not reveal the height.
    return float(np.clip(furthest / HANGING_HAND_SHARE, SHORTEST, TALLEST)) if furthest > 0.55 else USUAL_HEIGHT


def pose(positions: Floats, standing: Stature) -> BodyPose | None:
    """(P, 3) hands and head -> the body; None when none of them is seen."""
    known: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(positions), axis=1)
    if not known.any():
        return None
    tall = standing.height
    head = positions[HEAD] if known[HEAD] else standing.head
    hips = _hips(head, standing)
    spine = _unit(head - hips, np.array([0.0, 1.0, 0.0]))
    chest = head - NECK * tall * spine
    across = _across(positions, chest, known)
    sides = np.array([-1.0, 1.0])[:, None] * across
    shoulders = chest + HALF_SHOULDERS * tall * sides - 0.03 * tall * spine
    arms = [_arm(shoulders[i], positions[i], float(2 * i - 1), tall) if known[i] else None for i in (LEFT, RIGHT)]
    both_hips = hips + HALF_HIPS * tall * sides
    knees, ankles = _legs(both_hips, hips, standing)
    return BodyPose(
        head if known[HEAD] else None, spine, across, chest, shoulders, (arms[0], arms[1]), both_hips, knees, ankles
    )


def _hips(head: Floats, standing: Stature) -> Floats:
    """(3,) hips, a trunk and neck from the head, as high and as near to the standing position as possible.

    A low head away from the standing position means bending or lunging, a low head in place means bent knees.
    """
    length, leg = (TRUNK + NECK) * standing.height, LEG * standing.height
    offset = (head - standing.head) * [1.0, 0.0, 1.0]
    distance = float(np.linalg.norm(offset))
    above = float(head[1]) - (standing.floor + leg)
    lean = min(math.sqrt(max(length**2 - above**2, 0.0)), distance, 0.98 * length)
    hips = head - offset * (lean / distance if distance > 1e-9 else 0.0)
    rise = math.sqrt(length**2 - lean**2)
    hips[1] = np.clip(head[1] - rise, standing.floor + 0.3 * leg, standing.floor + 1.02 * leg)
    return hips


def _across(positions: Floats, chest: Floats, known: NDArray[np.bool_]) -> Floats:
    """(3,) to the performer's right, twisted towards the hand that is farther forward."""
    ahead = [float(chest[2] - positions[i, 2]) if known[i] else 0.0 for i in (LEFT, RIGHT)]
    twist = float(np.clip(0.7 * (ahead[1] - ahead[0]), -MOST_TWIST_RAD, MOST_TWIST_RAD))
    return np.array([math.cos(twist), 0.0, -math.sin(twist)])


def _arm(shoulder: Floats, hand: Floats, side: float, tall: float) -> Arm:
    elbow = _joint(shoulder, hand, UPPER_ARM * tall, FOREARM * tall, np.array([0.5 * side, -1.0, 0.3]))
    return Arm(shoulder, elbow, hand)


def _legs(both_hips: Floats, hips: Floats, standing: Stature) -> tuple[Floats, Floats]:
    """Knees and ankles (2, 3): the left foot stays behind, the right one steps as far as the hips have moved."""
    tall = standing.height
    moved = (hips - standing.head) * [1.0, 0.0, 1.0]
    moved = moved * min(1.0, LONGEST_STRIDE / max(float(np.linalg.norm(moved)), 1e-9))
    ankles = both_hips + 0.025 * tall * np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]) + np.stack([-moved, moved])
    ankles[:, 1] = standing.floor + ANKLE * tall
    pole = np.array([0.0, 0.0, -1.0])
    knees = [_joint(both_hips[i], ankles[i], THIGH * tall, SHIN * tall, pole) for i in range(2)]
    return np.stack(knees), ankles


def _joint(start: Floats, end: Floats, first: float, second: float, pole: Floats) -> Floats:
    """(3,) the joint between two links by the law of cosines, on the side of `pole`; on the line when out of reach."""
    line = end - start
    distance = float(np.linalg.norm(line))
    aim = _unit(line, np.array([0.0, -1.0, 0.0]))
    if distance >= first + second:
        return start + line * (first / (first + second))
    distance = max(distance, abs(first - second) + 1e-6)
    along = (first**2 - second**2 + distance**2) / (2 * distance)
    aside = math.sqrt(max(first**2 - along**2, 0.0))
    side = _unit(pole - (pole @ aim) * aim, np.array([0.0, 0.0, -1.0]))
    return start + along * aim + aside * side


def _unit(vector: Floats, otherwise: Floats) -> Floats:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 1e-9 else otherwise
