"""One body part over time: Kalman filter, gating, assignment and state; and which of two hands is the left one."""

import math
from collections import deque
from collections.abc import Sequence
from itertools import product
from statistics import median

import numpy as np

from observer.tracks import Floats, State

GATE = 13.8
"""Gate: the squared Mahalanobis distance that a part's own measurement stays below with probability 0.999 (chi², 2
degrees of freedom)."""


def assign(cost: Floats, gate: float) -> list[int | None]:
    """The optimal assignment: for each of P rows of `cost` (P, N) its column or None, each column at most once.

    Minimises the sum of the costs, where a row without a column costs `gate`, so that no pair above the gate is made.
    All assignments are enumerated: two hands have few, and scipy's solver takes more memory than the whole tracker.
    """
    within = [[None, *(column for column, c in enumerate(row) if c <= gate)] for row in cost.tolist()]

    def total(chosen: tuple[int | None, ...]) -> float:
        return sum(gate if column is None else float(cost[row, column]) for row, column in enumerate(chosen))

    cheapest = min((chosen for chosen in product(*within) if _each_once(chosen)), key=total)
    return list(cheapest)


def _each_once(columns: Sequence[int | None]) -> bool:
    taken = [column for column in columns if column is not None]
    return len(taken) == len(set(taken))


class ConstantVelocityFilter:
    """Kalman filter with a constant velocity and white-noise acceleration; state (4,): u, v, du/dt, dv/dt in px, px/s.

    x' = F x, P' = F P Fᵀ + Q with F = [[I, dt I], [0, I]] and, for an acceleration of standard deviation a held over
    the step, Q = a² [[dt⁴/4 I, dt³/2 I], [dt³/2 I, dt² I]] (Bar-Shalom, Li and Kirubarajan 2001, section 6.3.2).
    Both axes have equal variances and no covariance: P = [[p I, c I], [c I, q I]], three numbers.
    """

    def __init__(self, centre: Floats, acceleration: float, noise: float) -> None:
        """centre: (2,) px. acceleration: standard deviation, px/s², > 0. noise: that of a measurement, px, > 0."""
        self._acceleration, self._noise = acceleration, noise
        self.centre: Floats = np.asarray(centre, dtype=np.float64).copy()
        self.velocity: Floats = np.zeros(2)
        # The speed is unknown at first: assume what the acceleration reaches in a tenth of a second.
        self._p, self._c, self._q = noise**2, 0.0, (acceleration / 10) ** 2

    @property
    def variance(self) -> float:
        """Innovation variance in px²: of a measurement about `centre`, along either axis."""
        return self._p + self._noise**2

    def predict(self, seconds: float) -> None:
        """Predict `seconds` (≥ 0) ahead."""
        self.centre = self.centre + seconds * self.velocity
        a = (self._acceleration * seconds) ** 2
        self._p += seconds * (2 * self._c + seconds * self._q) + a * seconds**2 / 4
        self._c += seconds * self._q + a * seconds / 2
        self._q += a

    def correct(self, measured: Floats) -> None:
        """Update with a measured centre (2,) px."""
        innovation, variance = measured - self.centre, self.variance
        gain, velocity_gain = self._p / variance, self._c / variance
        self.centre = self.centre + gain * innovation
        self.velocity = self.velocity + velocity_gain * innovation
        self._q -= velocity_gain * self._c
        self._c *= 1 - gain
        # p r / (p + r) equals (1 - gain) p without the difference of two nearly equal numbers.
        self._p *= self._noise**2 / variance


HAND_ACCELERATION, HEAD_ACCELERATION = 150.0, 20.0
"""Standard deviations of the accelerations, face widths per s²: a fast wave of an arm; a step aside."""
NOISE = 0.15
"""Standard deviation of a measured centre, face widths: CAMshift finds the centre of the skin, not of the hand."""
COAST_S = 0.7
"""A part without a measurement for this long is missing, and may be found anywhere again."""
LOST_S, BRAKE_S = 0.3, 0.15
"""A part unseen for longer than LOST_S is not passing behind another: its velocity decays with constant BRAKE_S."""
AREAS_KEPT = 15
"""Number of areas in the median."""


class TrackedPart:
    """One body part with its filter and state; areas in px², lengths in px, times in seconds.

    area: median of the last areas measured. side: that of the square with this area. Both are nan before the first.
    """

    def __init__(self, acceleration: float) -> None:
        """acceleration: face widths per s²."""
        self._acceleration = acceleration
        self.state = State.MISSING
        self.filter: ConstantVelocityFilter | None = None
        self._areas: deque[float] = deque(maxlen=AREAS_KEPT)
        self.area = self.side = math.nan
        self._unseen_s = 0.0

    def _add_area(self, area: float) -> None:
        self._areas.append(area)
        self.area = median(self._areas)
        self.side = math.sqrt(self.area)

    def fits(self, area: float) -> bool:
        """Whether an area is 0.5 to 2 times the median: neither a fragment nor a hand merged with the face."""
        return 0.5 * self.area <= area <= 2 * self.area

    def expects(self, centre: Floats) -> bool:
        """Whether a measurement at `centre` (2,) is within the filter's gate."""
        if self.filter is None:
            return False
        away = centre - self.filter.centre
        return float(away @ away) < GATE * self.filter.variance

    @property
    def lost(self) -> bool:
        """Whether the part is missing, or unseen for longer than two hands take to cross."""
        return self.filter is None or self._unseen_s > LOST_S

    def acquire(self, centre: Floats, area: float, face: float) -> None:
        """Start at `centre` (2,) with `area`; `face`: face width in px, the unit of accelerations and noise."""
        self.filter = ConstantVelocityFilter(centre, self._acceleration * face, NOISE * face)
        self._areas.clear()
        self._add_area(area)
        self._unseen_s = 0.0
        self.state = State.SEEN

    def predict(self, seconds: float) -> None:
        """Predict the part's place so many seconds later, if it is followed."""
        if self.filter is not None:
            self.filter.predict(seconds)

    def measured(self, centre: Floats, area: float) -> None:
        """Update with a measurement that was assigned to this part."""
        if self.filter is None:
            return
        self.filter.correct(centre)
        self._add_area(min(max(area, 0.5 * self.area), 2 * self.area))
        self._unseen_s = 0.0
        self.state = State.SEEN

    def not_measured(self, seconds: float) -> None:
        """Record that this frame has no measurement: the part is unsure while it coasts, then missing."""
        self._unseen_s += seconds
        if self.filter is None or self._unseen_s > COAST_S:
            self.lose()
            return
        if self.lost:
            self.filter.velocity *= float(np.exp(-seconds / BRAKE_S))
        self.state = State.UNSURE

    def doubt(self) -> None:
        """Mark the part as unsure: the measurement may be of another part."""
        self.state = State.UNSURE

    def lose(self) -> None:
        """Mark the part as missing and forget its position."""
        self.filter, self.state = None, State.MISSING


LEFT, RIGHT = 0, 1
"""Rows of the hands, in the order of `observer.tracks.BODY_PARTS`."""


def name_two(centres: Sequence[Floats]) -> dict[int, int]:
    """Two new hands, centres (2,) px: row -> index into `centres`. The hand on the picture's left is the right hand."""
    right = int(centres[1][0] < centres[0][0])
    return {RIGHT: right, LEFT: 1 - right}


def name_first(centre: Floats, head: Floats, margin: float) -> int | None:
    """One new hand while none is tracked: the row of its side of the head; None within `margin` px of the head."""
    offset = float(centre[0] - head[0])
    if abs(offset) < margin:
        return None
    return RIGHT if offset < 0 else LEFT


def name_second(centre: Floats, known: Floats, row: int, head: Floats, margin: float) -> tuple[bool, bool]:
    """One new hand while the hand of `row` is tracked at `known` (2,) px: (accept it, exchange the two names).

    It is accepted on its own side of the other hand or of the head. If both hands are on each other's side of the head
    by more than `margin` px, the tracked hand took the lost hand's name in a crossing, and the names are exchanged.
    """
    outwards = -1.0 if row == LEFT else 1.0  # the side of the missing hand
    new, old = outwards * float(centre[0] - head[0]), outwards * float(known[0] - head[0])
    if new < -margin and old > margin:
        return True, True
    return new > old or new > margin, False


AMBIGUOUS = 6.0
"""Difference of squared distances below which the other hand's filter explains a measurement almost as well."""
SEPARATION = (0.6, 2.0)
"""Horizontal distance of the hands, face widths: less tells nothing about their sides, more counts as this much."""
MOST, INITIAL, DECISIVE = 3.0, 0.25, 0.08
"""Evidence for the names, face widths times seconds: its maximum, its value for new hands, the value that decides."""


class HandednessEvidence:
    """Evidence that the two hands have the right names, and when to exchange them.

    The filters carry the names through a crossing. When two hands meet and part, crossing and turning back look alike;
    then anatomy decides: the left hand is rarely for long on the right hand's right.
    """

    def __init__(self) -> None:
        self._evidence = INITIAL

    @property
    def doubtful(self) -> bool:
        """Whether the names may be exchanged."""
        return self._evidence < DECISIVE

    def add_assignment(self, cost: Floats, columns: Sequence[int | None]) -> None:
        """cost: (2, N) squared distances from LEFT and RIGHT. columns: the measurement assigned to each, or None."""
        left, right = columns
        worse = [cost[1 - row, column] - cost[row, column] for row, column in enumerate(columns) if column is not None]
        both = left is not None and right is not None
        # The names of two measured hands are exchanged together or not at all.
        if worse and (sum(worse) if both else min(worse)) < AMBIGUOUS:
            self._evidence = min(self._evidence, 0.0)

    def add_merge(self) -> None:
        """Note that the hands were one piece of skin: whether they crossed was not visible."""
        self._evidence = min(self._evidence, 0.0)

    def exchange(self, left: Floats, right: Floats, face: float, seconds: float) -> bool:
        """Whether to exchange the names of two seen hands, centres (2,) px, after `seconds` more; face: width, px."""
        separation = float(left[0] - right[0]) / face
        if abs(separation) > SEPARATION[0]:
            step = min(max(separation, -SEPARATION[1]), SEPARATION[1]) * seconds
            self._evidence = min(self._evidence + step, MOST)
        if self._evidence > -DECISIVE:
            return False
        self._evidence = DECISIVE
        return True
