"""The Kalman filter of one body part: a constant velocity, disturbed by random accelerations."""

import numpy as np

from observer.tracks import Floats

_EYE = np.eye(2)


class ConstantVelocity:
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
