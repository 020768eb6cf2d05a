"""The paper's belief: one factor per frame, the frame number given by a clock (section IV.B, (3) to (6))."""

import numpy as np

from common.probability import softmax
from observer.tracks import Floats


class FrameClock:
    """P(M_n+1 | i_1:n+1 b_1:n+1) proportional to P(M_n) P(b_n+1 | M i_n+1), from a uniform P(M) (6).

    bins: I_max. frames: how many frames the clock takes for all of them; it then stays at the last.
    """

    def __init__(self, movements: int, bins: int, frames: int) -> None:
        self._log_p = np.zeros(movements)
        self._bins, self._frames = bins, max(frames, 1)
        self._n = 0

    @property
    def i(self) -> int:
        """The bin of the coming frame, 0 to I_max - 1."""
        return min(self._n * self._bins // self._frames, self._bins - 1)

    def condition(self, log_likelihood: Floats) -> None:
        """(M,) log P(b | M i) of the coming frame, i as given by the clock."""
        self._log_p = self._log_p + log_likelihood
        self._log_p -= self._log_p.max()
        self._n += 1

    @property
    def p(self) -> Floats:
        """(M,) the posterior."""
        return softmax(self._log_p)
