"""The body of the synthetic performer: from a posture to the positions of hips, shoulders, elbows, hands and head.

Positions in metres on the axes of the archive: x to the performer's right, y up from the floor, z to the back.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from observer.tracks import Floats

Reach = tuple[float, float, float]
"""Position of a hand relative to its shoulder in arm lengths: outward (away from the middle), up, forward."""

MOTION_CHANNELS = 12
"""Numbers in a posture: right hand's reach, left hand's reach, step, side, drop, lean, twist, nod."""

RIGHT, LEFT, TRUNK = slice(0, 3), slice(3, 6), slice(6, 12)

# Shares of the length of an arm: fully bent, where stretching becomes noticeable, and nearly straight.
NEAREST, EASY, FULL = 0.27, 0.88, 0.995
ELBOW_POLE = (0.5, -1.0, 0.3)  # an elbow hangs down, a little outward and to the back


@dataclass(frozen=True, slots=True)
class Posture:
    """One posture. right, left: a hand's reach, None where it rests. step (forward), side (to the right), drop
    (of the hips): leg lengths. lean (forward), twist (right shoulder forward), nod (of the head): radians.
    """

    right: Reach | None = None
    left: Reach | None = None
    step: float = 0.0
    side: float = 0.0
    drop: float = 0.0
    lean: float = 0.0
    twist: float = 0.0
    nod: float = 0.0

    def vector(self, rest: Floats) -> Floats:
        """(12,) the channels in order; a hand that is None is as in `rest` (12,)."""
        trunk = (self.step, self.side, self.drop, self.lean, self.twist, self.nod)
        return np.array([*(self.right or rest[RIGHT]), *(self.left or rest[LEFT]), *trunk], dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Build:
    """Segment lengths in metres; hands end at the palm, the wrist is straight.

    leg: floor to hips. trunk: hips to the middle between the shoulders. neck: from there to the centre of the head.
    half_shoulders: from there to one shoulder. upper_arm: shoulder to elbow. forearm: elbow to the middle of the palm.
    """

    leg: float
    trunk: float
    neck: float
    half_shoulders: float
    upper_arm: float
    forearm: float

    @classmethod
    def of(cls, height: float) -> "Build":
        """The usual shares of the height (Drillis and Contini 1966)."""
        return cls(*(share * height for share in (0.530, 0.288, 0.118, 0.129, 0.186, 0.200)))

    @property
    def arm(self) -> float:
        """Shoulder to palm, stretched."""
        return self.upper_arm + self.forearm


@dataclass(frozen=True, slots=True)
class Skeleton:
    """Positions in metres at T instants. hips, head: (T, 3); shoulders, elbows, hands: (T, 2, 3), left then right."""

    hips: Floats
    shoulders: Floats
    elbows: Floats
    hands: Floats
    head: Floats

    @property
    def positions(self) -> Floats:
        """(T, 3, 3) left hand, right hand, head: the order of observer.tracks.BODY_PARTS."""
        return np.concatenate([self.hands, self.head[:, None]], axis=1)


def assume(build: Build, postures: Floats) -> Skeleton:
    """The body in each of (T, 12) postures. A hand never gets further from its shoulder than the arm is long."""
    step, side, drop, lean, twist, nod = postures[:, TRUNK].T
    hips = _places(build.leg * side, build.leg * (1 - drop), -build.leg * step)
    chest = hips + build.trunk * _upright(lean)
    head = chest + build.neck * _upright(lean + nod)
    across = build.half_shoulders * _places(np.cos(twist), np.zeros_like(twist), -np.sin(twist))
    shoulders = np.stack([chest - across, chest + across], axis=1)
    reaches = np.stack([postures[:, LEFT], postures[:, RIGHT]], axis=1)
    elbows, hands = _arms(build, shoulders, reaches)
    return Skeleton(hips, shoulders, elbows, hands, head)


def _arms(build: Build, shoulders: Floats, reaches: Floats) -> tuple[Floats, Floats]:
    """Elbows and hands (T, 2, 3) by inverse kinematics of two links: the law of cosines, the elbow near its pole."""
    outward = np.array([[-1.0, 1.0, -1.0], [1.0, 1.0, -1.0]])  # (out, up, forward) -> (x, y, z), left then right
    length = np.linalg.norm(reaches, axis=2, keepdims=True)
    aim = reaches * outward / np.maximum(length, 1e-9)
    distance = build.arm * _reachable(length)
    hands = shoulders + distance * aim
    along = (build.upper_arm**2 - build.forearm**2 + distance**2) / (2 * distance)
    aside = np.sqrt(np.maximum(build.upper_arm**2 - along**2, 0.0))
    pole = np.array(ELBOW_POLE) * np.array([[-1.0, 1.0, 1.0], [1.0, 1.0, 1.0]])
    away = pole - (pole * aim).sum(axis=2, keepdims=True) * aim
    # For an arm along the pole itself the direction of the elbow is undefined: it goes to the front.
    away = np.where(np.linalg.norm(away, axis=2, keepdims=True) > 1e-6, away, np.cross(aim, [1.0, 0.0, 0.0]))
    away /= np.maximum(np.linalg.norm(away, axis=2, keepdims=True), 1e-9)
    return shoulders + along * aim + aside * away, hands


def _reachable(length: Floats) -> Floats:
    """Requested -> reached arm lengths: eased to FULL above EASY, so that no hand stops with a jerk."""
    eased = EASY + (FULL - EASY) * np.tanh((length - EASY) / (FULL - EASY))
    return np.maximum(np.where(length > EASY, eased, length), NEAREST)


def _upright(angle: Floats) -> Floats:
    """(T, 3) unit vectors that lean forward by (T,) radians."""
    return _places(np.zeros_like(angle), np.cos(angle), -np.sin(angle))


def _places(*xyz: Floats) -> Floats:
    return np.stack(xyz, axis=-1)


def rest_vector(hand: Sequence[float]) -> Floats:
    """(12,) standing upright, both hands at the reach `hand`."""
    return np.array([*hand, *hand, *np.zeros(6)], dtype=np.float64)
