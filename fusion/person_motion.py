"""Where a person is and goes: a Kalman filter. Pure. The design: people.md, \"Among cameras\"."""

import math

import numpy as np

from common import SECOND_NS
from common.probability import Floats

SPEED_CHANGE = 1.0
"""m/s in a second, standard deviation: people begin to walk, and stop, within a second or two."""
TURN_S = 1.0
"""Whom nobody sees goes on for about so long; then they may have stopped or turned round."""


class Motion:
    """Where a person is and goes: a Kalman filter with nearly constant velocity.

    Bar-Shalom et al. 2001, section 6.3: discretised white noise in the acceleration; the velocity fades with TURN_S.
    """

    def __init__(self, at: Floats, covariance: Floats, at_ns: int) -> None:
        self._mean = np.array([*at, 0.0, 0.0])
        self._covariance = np.zeros((4, 4))
        self._covariance[:2, :2], self._covariance[2:, 2:] = covariance, SPEED_CHANGE**2 * np.eye(2)
        self._at_ns = at_ns
        self.seen_ns = at_ns
        """When the person was seen last."""

    def expected(self, at_ns: int) -> tuple[Floats, Floats]:
        """(2,) and (2, 2): the place at that time and its covariance."""
        mean, covariance = self._predicted(at_ns)
        return mean[:2], covariance[:2, :2]

    def update(self, at: Floats, covariance: Floats, at_ns: int) -> None:
        """Take in where an observer saw the person."""
        mean, prior = self._predicted(at_ns)
        gain = np.linalg.solve(prior[:2, :2] + covariance, prior[:2, :]).T
        self._mean = mean + gain @ (at - mean[:2])
        posterior = prior - gain @ prior[:2, :]
        self._covariance = (posterior + posterior.T) / 2
        self._at_ns, self.seen_ns = max(self._at_ns, at_ns), max(self.seen_ns, at_ns)

    def _predicted(self, at_ns: int) -> tuple[Floats, Floats]:
        s = max(at_ns - self._at_ns, 0) / SECOND_NS
        kept = math.exp(-s / TURN_S)
        step = np.eye(4)
        step[0, 2] = step[1, 3] = TURN_S * (1 - kept)
        step[2, 2] = step[3, 3] = kept
        noise = np.kron([[s**3 / 3, s**2 / 2], [s**2 / 2, s]], np.eye(2)) * SPEED_CHANGE**2
        return step @ self._mean, step @ self._covariance @ step.T + noise
