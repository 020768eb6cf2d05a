"""Tracks at any times, live or from a file, brought to an even rate as an observer's model sees them. Pure."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from statistics import median

import numpy as np
from numpy.typing import NDArray

from common import SECOND_NS
from observer.motion.archive import Span
from observer.tracks import Floats, Tracks

LONGEST_BRIDGE_S = 0.25
"""Over gaps up to this length a body part is taken to move in a straight line, whatever the camera's rate."""
BRIDGED_INTERVALS, WIDEST_BRIDGE_S = 1.5, 0.75
"""A slow camera's bridge follows its own interval, up to 2 Hz; a gap longer than that is no single picture late."""
INTERVALS, LEAST_INTERVALS = 8, 4
"""The interval is the median of the last eight gaps in which somebody was seen; fewer than four show none."""


def is_bridged(gap_s: float, interval_s: float) -> bool:
    """Whether motion is interpolated over a gap. interval_s: the camera's usual interval, this gap included."""
    return gap_s <= LONGEST_BRIDGE_S or gap_s <= min(BRIDGED_INTERVALS * interval_s, WIDEST_BRIDGE_S)


def at_even_rate(at_ns: NDArray[np.int64], centres: Floats, rate_hz: float) -> NDArray[np.float32]:
    """Tracks (F, P, 2) at increasing times (F,) -> (K, P, 2) at this rate from the first frame on, as `Resampler` does.

    Nothing is left out of gaps, however long: nothing is seen in them.
    """
    resampler = Resampler(rate_hz, (int(at_ns[-1]) - int(at_ns[0])) / SECOND_NS + 1)
    frames = zip(at_ns.tolist(), centres, strict=True)
    instants = [tracks.centres for at, frame in frames for tracks in resampler.update(at, Tracks(frame))]
    return np.array(instants, np.float32)


def spans_at_even_rate(spans: Sequence[Span], at_ns: NDArray[np.int64], rate_hz: float) -> tuple[Span, ...]:
    """Spans in frames with these times (F,) -> the same in frames of `at_even_rate`; none that has no frame there."""
    ends = np.append(at_ns, at_ns[-1] + SECOND_NS / rate_hz) - at_ns[0]
    frames = np.ceil(ends * rate_hz / SECOND_NS - 1e-6).astype(np.int64)
    moved = (replace(span, start=int(frames[span.start]), end=int(frames[span.end])) for span in spans)
    return tuple(span for span in moved if span.start < span.end)


STEADY = 0.5
"""A parabola needs a gap before the last one that is at least this share of it: through two sights that are close
together and a third far away it would overshoot."""
LONGEST_GAP_S = 3.0
"""In a longer gap the filter has forgotten all that it can forget."""


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

    def __init__(self, rate_hz: float, longest_gap_s: float = LONGEST_GAP_S) -> None:
        """rate_hz: the model's rate, > 0. longest_gap_s: a longer gap counts as this long."""
        self._period_ns = SECOND_NS / rate_hz
        self._most = round(longest_gap_s * SECOND_NS / self._period_ns)
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
        first = max(self._count, count - self._most)
        self._count = max(count, self._count)
        gap_s = (at_ns - previous[0]) / SECOND_NS
        if tracks.visible.any() and Tracks(previous[1]).visible.any():
            self._gaps_s.append(gap_s)
            self.interval_s = median(self._gaps_s) if len(self._gaps_s) >= LEAST_INTERVALS else 0.0
        bridged = is_bridged(gap_s, self.interval_s) or (skipped and gap_s <= WIDEST_BRIDGE_S)
        if skipped and bridged and before is not None and _is_steady(before[0], previous[0], at_ns):
            return [Tracks(_curved(before, previous, newest, self._instant_ns(i))) for i in range(first, count)]
        return [Tracks(_interpolate(previous, newest, self._instant_ns(i), bridged)) for i in range(first, count)]

    def restart(self) -> None:
        """Begin anew: the next frame shows another motion, and nothing lies between it and the previous one."""
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
