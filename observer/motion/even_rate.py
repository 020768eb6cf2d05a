"""Tracks at any times, live or from a file, brought to an even rate as an observer's model sees them. Pure."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from statistics import median

import numpy as np
from numpy.typing import NDArray

from common import SECOND_NS
from observer.motion.archive import Span
from observer.tracks import Floats

LONGEST_BRIDGE_S = 0.25
"""Over gaps up to this length a body part is taken to move in a straight line, whatever the camera's rate."""
BRIDGED_INTERVALS, WIDEST_BRIDGE_S = 1.5, 0.75
"""A slow camera's bridge follows its own interval, up to 2 Hz; a gap longer than that is no single picture late."""
INTERVALS, LEAST_INTERVALS = 8, 4
"""The interval is the median of the last eight gaps in which somebody was seen; fewer than four show none."""


def usual_interval_s(gaps_s: Collection[float]) -> float:
    """The interval of a camera's frames. gaps_s: the last INTERVALS between two frames that both show somebody."""
    return 0.0 if len(gaps_s) < LEAST_INTERVALS else median(gaps_s)


def is_bridged(gap_s: float, interval_s: float) -> bool:
    """Whether motion is interpolated over a gap. interval_s: the camera's usual interval, this gap included."""
    return gap_s <= LONGEST_BRIDGE_S or gap_s <= min(BRIDGED_INTERVALS * interval_s, WIDEST_BRIDGE_S)


def at_even_rate(at_ns: NDArray[np.int64], centres: Floats, rate_hz: float) -> NDArray[np.float32]:
    """Tracks (F, P, 2) at increasing times (F,) -> (K, P, 2) at this rate from the first frame on, linear in time.

    A part that is seen in only one of the two frames around an instant counts as seen where that frame is the nearer
    one. Nothing is seen between frames that are too far apart (`is_bridged`). The same, with one frame after the other,
    is `observer.runtime.resampler.Resampler`.
    """
    if len(at_ns) == 1:
        return centres.astype(np.float32)
    period_ns = SECOND_NS / rate_hz
    count = int((at_ns[-1] - at_ns[0]) / period_ns) + 1
    count += round(count * period_ns) <= at_ns[-1] - at_ns[0]
    instants = at_ns[0] + np.round(np.arange(count) * period_ns).astype(np.int64)
    after = np.maximum(np.searchsorted(at_ns, instants), 1)
    gaps = at_ns[after] - at_ns[after - 1]
    share = ((instants - at_ns[after - 1]) / gaps)[:, None, None]
    previous, newest = centres[after - 1], centres[after]
    mixed = (1 - share) * previous + share * newest
    mixed = np.where(np.isfinite(mixed), mixed, np.where(share > 0.5, newest, previous))
    near = _bridged(at_ns, centres)[after - 1][:, None, None]
    # The instant of a frame itself needs no other frame.
    between = np.where(near, mixed, np.nan)
    return np.where(share <= 0, previous, np.where(share >= 1, newest, between)).astype(np.float32)


def _bridged(at_ns: NDArray[np.int64], centres: Floats) -> NDArray[np.bool_]:
    """(F - 1,) whether each gap is bridged."""
    gaps_s = np.diff(at_ns) / SECOND_NS
    bridged: NDArray[np.bool_] = gaps_s <= LONGEST_BRIDGE_S
    if bridged.all():
        return bridged
    shown: NDArray[np.bool_] = np.logical_or.reduce(np.isfinite(centres[..., 0]), axis=1)
    counted = np.flatnonzero(shown[1:] & shown[:-1])
    for n in np.flatnonzero(~bridged):
        last = counted[: np.searchsorted(counted, n, side="right")][-INTERVALS:]
        bridged[n] = is_bridged(float(gaps_s[n]), usual_interval_s(gaps_s[last].tolist()))
    return bridged


def spans_at_even_rate(spans: Sequence[Span], at_ns: NDArray[np.int64], rate_hz: float) -> tuple[Span, ...]:
    """Spans in frames with these times (F,) -> the same in frames of `at_even_rate`; none that has no frame there."""
    ends = np.append(at_ns, at_ns[-1] + SECOND_NS / rate_hz) - at_ns[0]
    frames = np.ceil(ends * rate_hz / SECOND_NS - 1e-6).astype(np.int64)
    moved = (replace(span, start=int(frames[span.start]), end=int(frames[span.end])) for span in spans)
    return tuple(span for span in moved if span.start < span.end)
