"""The Kalman filter of one body part: a constant velocity, disturbed by random accelerations."""

import numpy as np

from observer.tracks import Floats


class ConstantVelocity:
    """State (4,): u, v, du/dt, dv/dt in px and px/s; covariance (4, 4).

    x' = F x, P' = F P Fᵀ + Q with F = [[I, dt I], [0, I]] and, for an acceleration of standard deviation a held over
    the step, Q = a² [[dt⁴/4 I, dt³/2 I], [dt³/2 I, dt² I]] (Bar-Shalom, Li and Kirubarajan 2001, section 6.3.2).
    """

    def __init__(self, centre: Floats, acceleration: float, noise: float) -> None:
        """centre: (2,) px; acceleration: px/s², > 0; noise: standard deviation of a measurement, px, > 0."""
        self._acceleration, self._noise = acceleration, noise
        self.state: Floats = np.concatenate([np.asarray(centre, dtype=np.float64), np.zeros(2)])
        # The speed is unknown at first: as fast as the acceleration would make it in a tenth of a second.
        self.covariance: Floats = np.diag([noise**2] * 2 + [(acceleration / 10) ** 2] * 2)

    @property
    def centre(self) -> Floats:
        """(2,) px: where the part is thought to be."""
        return self.state[:2]

    @property
    def spread(self) -> Floats:
        """(2, 2) px²: covariance of a measurement about `centre`."""
        return self.covariance[:2, :2] + np.eye(2) * self._noise**2

    def predict(self, seconds: float) -> None:
        """Let `seconds` (≥ 0) pass."""
        eye, zero = np.eye(2), np.zeros((2, 2))
        F = np.block([[eye, seconds * eye], [zero, eye]])
        gain = np.vstack([seconds**2 / 2 * eye, seconds * eye])
        self.state = F @ self.state
        self.covariance = F @ self.covariance @ F.T + self._acceleration**2 * gain @ gain.T

    def correct(self, measured: Floats) -> None:
        """Take in a measured centre (2,) px; Joseph form, which keeps the covariance symmetric and positive."""
        H = np.eye(2, 4)
        K = np.linalg.solve(self.spread, H @ self.covariance).T
        rest = np.eye(4) - K @ H
        self.state = self.state + K @ (measured - self.centre)
        self.covariance = rest @ self.covariance @ rest.T + self._noise**2 * K @ K.T
