"""One body part over time: its Kalman filter, gating, assignment of measurements, and its state."""

import math
from collections import deque
from collections.abc import Sequence
from itertools import product
from statistics import median

import numpy as np

from observer.tracks import Floats, State

GATE = 13.8
"""Squared Mahalanobis distance that a part's own measurement stays under with probability 0.999 (chi², 2 degrees)."""


def squared_distances(predicted: Sequence[tuple[Floats, Floats]], measured: Floats) -> Floats:
    """(P, N) squared Mahalanobis distances of measurements (N, 2) from P predictions: centre (2,), spread (2, 2)."""
    rows = []
    for centre, spread in predicted:
        away = measured - centre
        rows.append(np.einsum("ni,ij,nj->n", away, np.linalg.inv(spread), away))
    return np.array(rows, dtype=np.float64).reshape(len(predicted), len(measured))


def assign(cost: Floats, gate: float) -> list[int | None]:
    """For each of P rows of cost (P, N) its column, or None; each column at most once.

    Minimises the sum of the costs where leaving a row without column costs `gate`; so no pair above the gate is ever
    made. Every assignment is looked at: two hands have few, and a solver for many would take more memory than all of
    the tracker.
    """
    within = [[None, *(column for column, c in enumerate(row) if c <= gate)] for row in cost.tolist()]

    def total(chosen: tuple[int | None, ...]) -> float:
        return sum(gate if column is None else float(cost[row, column]) for row, column in enumerate(chosen))

    cheapest = min((chosen for chosen in product(*within) if _each_once(chosen)), key=total)
    return list(cheapest)


def _each_once(columns: Sequence[int | None]) -> bool:
    taken = [column for column in columns if column is not None]
    return len(taken) == len(set(taken))


_EYE = np.eye(2)


class ConstantVelocityFilter:
    """State (4,): u, v, du/dt, dv/dt in px and px/s; covariance (4, 4).

    x' = F x, P' = F P Fᵀ + Q with F = [[I, dt I], [0, I]] and, for an acceleration of standard deviation a held over
    the step, Q = a² [[dt⁴/4 I, dt³/2 I], [dt³/2 I, dt² I]] (Bar-Shalom, Li and Kirubarajan 2001, section 6.3.2).
    Both axes have the same variances and no covariance: P = [[p I, c I], [c I, q I]], three numbers.
    """

    def __init__(self, centre: Floats, acceleration: float, noise: float) -> None:
        """centre: (2,) px; acceleration: px/s², > 0; noise: standard deviation of a measurement, px, > 0."""
        self._acceleration, self._noise = acceleration, noise
        self.centre: Floats = np.asarray(centre, dtype=np.float64).copy()
        self.velocity: Floats = np.zeros(2)
        # The speed is unknown at first: as fast as the acceleration would make it in a tenth of a second.
        self._p, self._c, self._q = noise**2, 0.0, (acceleration / 10) ** 2

    @property
    def variance(self) -> float:
        """px²: variance of a measurement about `centre`, along either axis."""
        return self._p + self._noise**2

    @property
    def spread(self) -> Floats:
        """(2, 2) px²: covariance of a measurement about `centre`."""
        return self.variance * _EYE

    @property
    def state(self) -> Floats:
        """(4,): centre and velocity."""
        return np.concatenate([self.centre, self.velocity])

    @property
    def covariance(self) -> Floats:
        """(4, 4): of the state."""
        return np.kron(np.array([[self._p, self._c], [self._c, self._q]]), _EYE)

    def predict(self, seconds: float) -> None:
        """Let `seconds` (≥ 0) pass."""
        self.centre = self.centre + seconds * self.velocity
        a = (self._acceleration * seconds) ** 2
        self._p += seconds * (2 * self._c + seconds * self._q) + a * seconds**2 / 4
        self._c += seconds * self._q + a * seconds / 2
        self._q += a

    def correct(self, measured: Floats) -> None:
        """Take in a measured centre (2,) px."""
        away, spread = measured - self.centre, self.variance
        gain, pull = self._p / spread, self._c / spread
        self.centre = self.centre + gain * away
        self.velocity = self.velocity + pull * away
        self._q -= pull * self._c
        self._c *= 1 - gain
        # p r / (p + r): what is left of p, without the difference of two nearly equal numbers.
        self._p *= self._noise**2 / spread


HAND_ACCELERATION, HEAD_ACCELERATION = 150.0, 20.0
"""Standard deviations of the accelerations, face widths a second squared: a fast wave of an arm; a step aside."""
NOISE = 0.15
"""Standard deviation of a measured centre, face widths: CAMshift finds the middle of the skin, not of the hand."""
COAST_S = 0.7
"""A part that was not measured for so long is missing, and may be found anywhere again."""
LOST_S, BRAKE_S = 0.3, 0.15
"""A part unseen for longer is not thought to pass behind another: it comes to rest, with this time constant."""
SIZES = 15
"""How many areas the median is of."""


class TrackedPart:
    """A part with its filter; areas in px², lengths in px, times in seconds.

    area: median of the areas measured so far, side: of the square with that area; nan before the first.
    """

    def __init__(self, acceleration: float) -> None:
        """acceleration: face widths a second squared."""
        self._acceleration = acceleration
        self.state = State.MISSING
        self.filter: ConstantVelocityFilter | None = None
        self._areas: deque[float] = deque(maxlen=SIZES)
        self.area = self.side = math.nan
        self._unseen_s = 0.0

    def _sized(self, area: float) -> None:
        self._areas.append(area)
        self.area = median(self._areas)
        self.side = math.sqrt(self.area)

    def fits(self, area: float) -> bool:
        """Whether an area is within 0.5 to 2 of the median: neither a crumb nor a hand grown together with the face."""
        return 0.5 * self.area <= area <= 2 * self.area

    def expects(self, centre: Floats) -> bool:
        """Whether a measurement at `centre` (2,) is within the filter's gate."""
        if self.filter is None:
            return False
        away = centre - self.filter.centre
        return float(away @ away) < GATE * self.filter.variance

    @property
    def lost(self) -> bool:
        """Whether it is missing, or unseen for longer than a crossing of two hands takes."""
        return self.filter is None or self._unseen_s > LOST_S

    def acquire(self, centre: Floats, area: float, face: float) -> None:
        """Begin at `centre` (2,) with `area`; `face` is the face's width, the unit of accelerations and noise."""
        self.filter = ConstantVelocityFilter(centre, self._acceleration * face, NOISE * face)
        self._areas.clear()
        self._sized(area)
        self._unseen_s = 0.0
        self.state = State.SEEN

    def predict(self, seconds: float) -> None:
        """Let time pass."""
        if self.filter is not None:
            self.filter.predict(seconds)

    def measured(self, centre: Floats, area: float) -> None:
        """A measurement assigned to this part."""
        if self.filter is None:
            return
        self.filter.correct(centre)
        self._sized(min(max(area, 0.5 * self.area), 2 * self.area))
        self._unseen_s = 0.0
        self.state = State.SEEN

    def not_measured(self, seconds: float) -> None:
        """No measurement in this frame: unsure while it coasts, then missing."""
        self._unseen_s += seconds
        if self.filter is None or self._unseen_s > COAST_S:
            self.lose()
            return
        if self.lost:
            self.filter.velocity *= float(np.exp(-seconds / BRAKE_S))
        self.state = State.UNSURE

    def doubt(self) -> None:
        """Measured, but perhaps this is another part."""
        self.state = State.UNSURE

    def lose(self) -> None:
        """Missing; where it was is forgotten."""
        self.filter, self.state = None, State.MISSING
