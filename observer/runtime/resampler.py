"""Brings tracks to the fixed rate of a model, one frame after the other. Pure."""

from collections import deque

import numpy as np

from common import SECOND_NS
from observer.motion.even_rate import INTERVALS, WIDEST_BRIDGE_S, is_bridged, usual_interval_s
from observer.tracks import Floats, Tracks

STEADY = 0.5
"""A parabola needs a gap before the last one that is at least this share of it: through two sights that are close
together and a third far away it would overshoot."""
LONGEST_GAP_S = 3.0
"""A longer gap counts as this long: by then the filter has forgotten all that it can forget."""


Sight = tuple[int, Floats]
"""When a frame was captured, ns, and the centres (P, 2) in it."""


class Resampler:
    """Resamples tracks from any frame times to a model's fixed rate, by linear interpolation.

    Between two frames of which the observer left out some, a part moves on the parabola through its last three sights
    (constant acceleration): straight lines between few pictures cut the turning points of a movement.

    The model therefore sees the same motion from a faster camera, a slower one, or one that drops frames. There is no
    delay: each instant is returned with the first frame at or after it. Over a gap that is too long for the camera's
    rate (`observer.motion.even_rate.is_bridged`) nothing is seen; if the observer left out frames in it, the camera was
    not away, and it may be as long as that of the slowest camera.
    """

    def __init__(self, rate_hz: float) -> None:
        """rate_hz: the model's rate, > 0."""
        self._period_ns = SECOND_NS / rate_hz
        self._begin_ns = 0
        self._count = 0
        self._previous: Sight | None = None
        self._before: Sight | None = None
        """The frame before `_previous`."""
        self._gaps_s: deque[float] = deque(maxlen=INTERVALS)
        self.interval_s = 0.0
        """The usual time between two frames; 0 while it is not known."""

    def update(self, at_ns: int, tracks: Tracks, skipped: bool = False) -> list[Tracks]:
        """The instants after the previous frame, up to this frame at `at_ns`: any number of tracks (P, 2).

        skipped: frames were left out before it, so that the camera was not away.
        A part that is seen in only one of the two frames around an instant counts as seen where that frame is the
        nearer one. If the clock is set back, sampling restarts.
        """
        newest = (at_ns, tracks.centres)
        previous, self._previous = self._previous, newest
        if previous is None or at_ns < previous[0]:
            self._before = None
            self._begin_ns, self._count = at_ns, 1
            return [tracks]
        if at_ns == previous[0]:
            return []
        before, self._before = self._before, previous
        count = int((at_ns - self._begin_ns) / self._period_ns) + 1
        count += self._instant_ns(count) <= at_ns  # rounding must not hold an instant back
        first = max(self._count, count - round(LONGEST_GAP_S * SECOND_NS / self._period_ns))
        self._count = max(count, self._count)
        gap_s = (at_ns - previous[0]) / SECOND_NS
        if tracks.visible.any() and Tracks(previous[1]).visible.any():
            self._gaps_s.append(gap_s)
            self.interval_s = usual_interval_s(self._gaps_s)
        bridged = is_bridged(gap_s, self.interval_s) or (skipped and gap_s <= WIDEST_BRIDGE_S)
        if skipped and bridged and before is not None and _is_steady(before[0], previous[0], at_ns):
            return [Tracks(_curved(before, previous, newest, self._instant_ns(i))) for i in range(first, count)]
        return [Tracks(_interpolate(previous, newest, self._instant_ns(i), bridged)) for i in range(first, count)]

    def restart(self) -> None:
        """The next frame shows another motion: nothing lies between it and the previous one."""
        self._previous = self._before = None

    def _instant_ns(self, i: int) -> int:
        return self._begin_ns + round(i * self._period_ns)


def _is_steady(before_ns: int, previous_ns: int, newest_ns: int) -> bool:
    gap_ns = previous_ns - before_ns
    return STEADY * (newest_ns - previous_ns) <= gap_ns <= WIDEST_BRIDGE_S * SECOND_NS


def _curved(before: Sight, previous: Sight, newest: Sight, instant_ns: int) -> Floats:
    """The parabola through three sights (Lagrange), between the last two; where one is missing, `_interpolate`."""
    t0, t1, t2 = (sight[0] - instant_ns for sight in (before, previous, newest))
    parabola = (
        before[1] * (t1 * t2 / ((t0 - t1) * (t0 - t2)))
        + previous[1] * (t0 * t2 / ((t1 - t0) * (t1 - t2)))
        + newest[1] * (t0 * t1 / ((t2 - t0) * (t2 - t1)))
    )
    return np.where(np.isfinite(parabola), parabola, _interpolate(previous, newest, instant_ns, True))


def _interpolate(previous: Sight, newest: Sight, instant_ns: int, bridged: bool) -> Floats:
    share = (instant_ns - previous[0]) / (newest[0] - previous[0])
    if not bridged:
        return newest[1] if share >= 1 else np.full_like(newest[1], np.nan)
    nearer = newest[1] if share > 0.5 else previous[1]
    mixed = (1 - share) * previous[1] + share * newest[1]
    return np.where(np.isfinite(mixed), mixed, nearer)
