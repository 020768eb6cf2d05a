"""One body part over time: its filter, its size, and whether it is seen, unsure or missing."""

import math
from collections import deque
from statistics import median

import numpy as np

from observer.tracking.assignment import GATE
from observer.tracking.kalman import ConstantVelocity
from observer.tracks import Floats, State

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


class Part:
    """A part with its filter; areas in px², lengths in px, times in seconds.

    area: median of the areas measured so far, side: of the square with that area; nan before the first.
    """

    def __init__(self, acceleration: float) -> None:
        """acceleration: face widths a second squared."""
        self._acceleration = acceleration
        self.state = State.MISSING
        self.filter: ConstantVelocity | None = None
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
        self.filter = ConstantVelocity(centre, self._acceleration * face, NOISE * face)
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
