"""Keeps left and right of a pose model's landmarks through pictures in which the model exchanges them. Pure.

A pose model tells left from right in each picture anew, by how the whole body looks. Where it sees a back, no face or a
profile, it may exchange them from one picture to the next, for the whole body or for a pair of limbs. A person cannot
turn as fast: the line from the right to the left shoulder, elbow or hip takes a fifth of a second.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.tracks import Floats

PAIRS = ((11, 12), (23, 24), (13, 14), (15, 16), (25, 26), (27, 28))
"""Landmarks (left, right) whose difference is compared: shoulders, hips, elbows, wrists, knees, ankles."""
LEFT_RIGHT = ((1, 4), (2, 5), (3, 6), (7, 8), (9, 10), *((n, n + 1) for n in range(11, 33, 2)))
"""All landmarks (left, right) of BlazePose."""
TRUNK, EVERY = (0, 1), tuple(range(6))
"""Rows of PAIRS that tell whether the whole body is exchanged, and all of them."""
ARMS, LEGS = tuple(range(13, 23)), tuple(range(25, 33))
LIMBS = ((ARMS, (2, 3), (11, 12)), (LEGS, (4, 5), (23, 24)))
"""Each limb's landmarks, its rows in PAIRS, and the joints of the trunk that carry it."""
TOES, HEELS = (31, 32), (29, 30)

MEMORY_S = 0.1
"""Time constant of the remembered differences, and of their speed: a person who turns goes on turning."""
LONGEST_S = 0.4
"""After a longer time without a person the model's sides are taken as they are."""
CLEARER, CLEARER_LIMB = 0.5, 0.25
"""An exchange must explain the differences so much better: its squared distances are less than this share. Raised arms
cross in a few frames."""
LEAST_OF_TRUNK, LEAST_OF_ALL, LEAST_OF_LIMB = 0.15, 0.5, 0.2
"""Squared body sizes by which it must, for the trunk, all pairs and a limb, so that a body in profile, whose sides
coincide, is left as it is."""
LEAP = 1.5
"""Body sizes: a person farther from the place in the last picture is another one."""
TRUST_S, DISTRUST_S = 2.0, 0.2
"""Most trust in the sides so far, in seconds of agreement with the model; and for how long the model must contradict
them, once that trust is used up, before its sides are taken over: it is right most of the time."""
LEVEL, SPREAD = 0.05, 0.1
"""Of a person who faces the camera the toes are lower in the picture than the heels by more than LEVEL body sizes, of
one who turns away by less (four cameras of pose2sim_single); SPREAD: from doubt to certainty."""
DOUBT, LEAST_WEIGHT, FEET_SEEN = 0.7, 0.2, 0.5
"""Share of a frame's weight that depends on whether feet and shoulders face the same way, its least weight, and the
visibility from which feet tell."""


def _permutation(rows: tuple[int, ...] | None = None) -> NDArray[np.int64]:
    """Rows of the landmarks with left and right exchanged: all, or of these only."""
    order = np.arange(33)
    for left, right in LEFT_RIGHT:
        if rows is None or left in rows:
            order[[left, right]] = right, left
    return order


EXCHANGED, EXCHANGED_LIMBS = _permutation(), tuple(_permutation(rows) for rows, _, _ in LIMBS)
_LEFT, _RIGHT = (list(side) for side in zip(*PAIRS, strict=True))


@dataclass(slots=True)
class _Memory:
    """differences: (6, 2) of PAIRS, left minus right; expected: the same in the newest picture, by those before it;
    speeds: a second; middle: (2,) of the trunk; size: of the body; all in one unit.
    """

    differences: Floats
    expected: Floats
    speeds: Floats
    middle: Floats
    size: float
    ms: int

    @classmethod
    def of(cls, points: Floats, size: float, ms: int) -> "_Memory":
        differences = _differences(points)
        return cls(differences, differences, np.zeros_like(differences), _middle(points), size, ms)

    def is_of_another(self, points: Floats, size: float, ms: int) -> bool:
        """Whether too much time has passed, or the person is somewhere else."""
        away = _apart(_middle(points), self.middle)
        return ms - self.ms > 1000 * LONGEST_S or away > LEAP * max(size, self.size)

    def expect(self, seconds: float) -> None:
        """Foresee the differences after so many seconds."""
        self.expected = self.differences + seconds * self.speeds

    def turn(self) -> None:
        """Exchange the sides of all that is remembered."""
        self.differences, self.expected, self.speeds = -self.differences, -self.expected, -self.speeds

    def follow(self, points: Floats, size: float, ms: int, seconds: float) -> None:
        """Take in the mended points of the newest picture, `seconds` after the last, by an alpha-beta filter.

        β = α²/(2 - α): Benedict and Bordner, IRE Transactions on Automatic Control 7, 1962.
        """
        share = 1 - math.exp(-seconds / MEMORY_S)
        away = _differences(points) - self.expected
        self.differences = self.expected + share * away
        self.speeds = self.speeds + share**2 / (2 - share) * away / seconds
        self.size += share * (size - self.size)
        self.middle, self.ms = _middle(points), ms


class SideKeeper:
    """Exchanges left and right of landmarks back where a pose model has exchanged them."""

    def __init__(self) -> None:
        self._memory: _Memory | None = None
        self.exchanged = False
        """Whether the model's whole body was exchanged in the newest frame."""
        self._trust_s = 0.0

    def update(self, landmarks: Floats, ms: int, aspect: float = 1.0) -> Floats:
        """(33, 3) u, v, visibility -> the same with the person's own sides; `landmarks` is not changed.

        ms: time, increasing. aspect: width over height of the picture, if u and v are shares of these.
        """
        points = landmarks[:, :2] * (aspect, 1.0)
        memory, size = self._memory, _size(points)
        if not math.isfinite(size) or size <= 0:
            return landmarks
        if memory is None or memory.is_of_another(points, size, ms):
            self.exchanged, self._trust_s = False, 0.0
            self._memory = _Memory.of(points, size, ms)
            return landmarks
        seconds = max(ms - memory.ms, 1) / 1000
        memory.expect(seconds)
        self.exchanged = self._is_whole_exchanged(_differences(points), memory)
        self._weigh(landmarks, points, memory, seconds)
        order = EXCHANGED if self.exchanged else np.arange(33)
        order = self._with_limbs(points, memory, order)
        memory.follow(points[order], size, ms, seconds)
        return landmarks[order]

    def _is_whole_exchanged(self, differences: Floats, memory: _Memory) -> bool:
        """By the trunk, or where that does not tell, in profile, by the limbs too; else as so far."""
        for rows, least in ((TRUNK, LEAST_OF_TRUNK), (EVERY, LEAST_OF_ALL)):
            exchanged = _is_exchanged(differences, memory, rows, CLEARER, least)
            if exchanged is not None:
                return exchanged
        return self.exchanged

    def _with_limbs(self, points: Floats, memory: _Memory, order: NDArray[np.int64]) -> NDArray[np.int64]:
        """The order with the limbs exchanged that the model has exchanged against the trunk."""
        for (_, rows, carriers), limb in zip(LIMBS, EXCHANGED_LIMBS, strict=True):
            placed, turned = points[order], points[order[limb]]
            fits = _reach(turned, rows, carriers) <= _reach(placed, rows, carriers)
            if fits and _is_exchanged(_differences(placed), memory, rows, CLEARER_LIMB, LEAST_OF_LIMB):
                order = order[limb]
        return order

    def _weigh(self, landmarks: Floats, points: Floats, memory: _Memory, seconds: float) -> None:
        """Trust in the sides so far, by the model's own; when it is gone, the model's are taken over."""
        weight = max(1 - DOUBT + DOUBT * _consistency(landmarks, points, memory.size), LEAST_WEIGHT)
        self._trust_s += -seconds * weight if self.exchanged else seconds * weight
        self._trust_s = min(self._trust_s, TRUST_S)
        if self._trust_s < -DISTRUST_S:
            self.exchanged, self._trust_s = False, DISTRUST_S
            memory.turn()


def _differences(points: Floats) -> Floats:
    return points[_LEFT] - points[_RIGHT]


def _middle(points: Floats) -> Floats:
    middle: Floats = points[[11, 12, 23, 24]].mean(axis=0)
    return middle


def _apart(one: Floats, other: Floats) -> float:
    return math.hypot(one[0] - other[0], one[1] - other[1])


def _size(points: Floats) -> float:
    """Of the body: the torso's length, or the shoulders' width where the person is seen from above."""
    shoulders, hips = points[[11, 12]], points[[23, 24]]
    return max(_apart(shoulders.mean(axis=0), hips.mean(axis=0)), _apart(shoulders[0], shoulders[1]))


def _is_exchanged(
    differences: Floats, memory: _Memory, rows: tuple[int, ...], clearer: float, least: float
) -> bool | None:
    """Whether these PAIRS continue the remembered ones with their sides exchanged; None: neither is clear."""
    now, before = differences[list(rows)], memory.expected[list(rows)]
    as_it_is = float(((now - before) ** 2).sum()) / memory.size**2
    turned = float(((now + before) ** 2).sum()) / memory.size**2
    if min(as_it_is, turned) > clearer * max(as_it_is, turned) or abs(turned - as_it_is) < least:
        return None
    return turned < as_it_is


def _reach(points: Floats, rows: tuple[int, ...], carriers: tuple[int, int]) -> float:
    """How far elbows or knees are from the shoulders or hips of their sides, in sum."""
    joints = points[list(PAIRS[rows[0]])] - points[list(carriers)]
    return float(np.hypot(joints[:, 0], joints[:, 1]).sum())


def _consistency(landmarks: Floats, points: Floats, size: float) -> float:
    """-1 to 1: whether the model's feet face the same way as its shoulders, towards the camera or away; 0: unclear."""
    feet = landmarks[[*TOES, *HEELS]]
    if (feet[:, 1] > 1).any() or (feet[:, 2] < FEET_SEEN).any():
        return 0.0
    facing = float(points[11, 0] - points[12, 0]) / size
    lower = float(points[list(TOES), 1].mean() - points[list(HEELS), 1].mean()) / size
    if not lower:  # a model without feet, whose toes and heels are its ankles
        return 0.0
    return _within_one(5 * facing) * _within_one((lower - LEVEL) / SPREAD)


def _within_one(number: float) -> float:
    return min(max(number, -1.0), 1.0)
