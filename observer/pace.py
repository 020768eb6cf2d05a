"""Frames come when a camera gives them; a model counts at its own rate. This brings the two together. Pure."""

import numpy as np

from observer.tracks import Floats, Tracks

SECOND_NS = 1_000_000_000
BRIDGE_S = 0.25
"""Between two frames no further apart than this a part moved in a straight line; over longer gaps nothing is known."""
BLIND_S = 3.0
"""A longer gap counts as this long: all that can be forgotten about a movement is forgotten by then."""


class Pace:
    """Tracks at any times in, tracks at a model's rate out, by linear interpolation between neighbouring frames.

    A camera faster than the model, slower, or with frames left out: the belief sees the same motion. Nothing is
    delayed: an instant is handed out with the first frame at or after it.
    """

    def __init__(self, rate_hz: float) -> None:
        """rate_hz: the model's, > 0."""
        self._period_ns = SECOND_NS / rate_hz
        self._begin_ns = 0
        self._count = 0
        self._before: tuple[int, Floats] | None = None

    def due(self, at_ns: int, tracks: Tracks) -> list[Tracks]:
        """The instants after the frame before, up to this frame at `at_ns`: none, one or several (P, 2) each.

        A part that only one of the two frames around an instant shows is seen where that frame is the nearer one.
        A clock that was set back begins anew.
        """
        before, self._before = self._before, (at_ns, tracks.centres)
        if before is None or at_ns <= before[0]:
            if before is None or at_ns < before[0]:
                self._begin_ns, self._count = at_ns, 1
                return [tracks]
            return []
        count = int((at_ns - self._begin_ns) / self._period_ns) + 1
        count += self._instant(count) <= at_ns  # rounding must not hold an instant back
        first = max(self._count, count - round(BLIND_S * SECOND_NS / self._period_ns))
        self._count = max(count, self._count)
        return [Tracks(_between(before, (at_ns, tracks.centres), self._instant(i))) for i in range(first, count)]

    def _instant(self, i: int) -> int:
        return self._begin_ns + round(i * self._period_ns)


def _between(before: tuple[int, Floats], now: tuple[int, Floats], instant_ns: int) -> Floats:
    share = (instant_ns - before[0]) / (now[0] - before[0])
    if now[0] - before[0] > BRIDGE_S * SECOND_NS:
        return now[1] if share >= 1 else np.full_like(now[1], np.nan)
    nearer = now[1] if share > 0.5 else before[1]
    mixed = (1 - share) * before[1] + share * now[1]
    straight: Floats = np.where(np.isfinite(mixed), mixed, nearer)
    return straight
