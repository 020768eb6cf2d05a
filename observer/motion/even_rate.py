"""Tracks at any times, live or from a file, brought to an even rate as an observer's model sees them. Pure."""

from collections.abc import Sequence
from dataclasses import replace

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
"""The interval is the median of the last eight gaps; fewer than four show none."""


def longest_bridge_s(gaps_s: Sequence[float]) -> float:
    """Over which gap motion is interpolated. gaps_s: the last INTERVALS, the one in question included."""
    if len(gaps_s) < LEAST_INTERVALS:
        return LONGEST_BRIDGE_S
    interval_s = float(np.median(gaps_s))
    return min(max(LONGEST_BRIDGE_S, BRIDGED_INTERVALS * interval_s), WIDEST_BRIDGE_S)


def is_bridged(gaps_s: Sequence[float]) -> bool:
    """Whether motion is interpolated over the last of these gaps; gaps_s: as in `longest_bridge_s`."""
    return gaps_s[-1] <= LONGEST_BRIDGE_S or gaps_s[-1] <= longest_bridge_s(gaps_s)


def at_even_rate(at_ns: NDArray[np.int64], centres: Floats, rate_hz: float) -> NDArray[np.float32]:
    """Tracks (F, P, 2) at increasing times (F,) -> (K, P, 2) at this rate from the first frame on, linear in time.

    A part that is seen in only one of the two frames around an instant counts as seen where that frame is the nearer
    one. Nothing is seen between frames that are too far apart (`is_bridged`). The same, with one frame after the other,
    is `observer.runtime.pipeline.Resampler`.
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
    near = _bridged(np.diff(at_ns))[after - 1][:, None, None]
    # The instant of a frame itself needs no other frame.
    between = np.where(near, mixed, np.nan)
    return np.where(share <= 0, previous, np.where(share >= 1, newest, between)).astype(np.float32)


def _bridged(gaps_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(F - 1,) whether each gap is bridged."""
    gaps_s = gaps_ns / SECOND_NS
    bridged: NDArray[np.bool_] = gaps_s <= LONGEST_BRIDGE_S
    for n in np.flatnonzero(~bridged):
        bridged[n] = is_bridged(gaps_s[max(n + 1 - INTERVALS, 0) : n + 1].tolist())
    return bridged


def spans_at_even_rate(spans: Sequence[Span], at_ns: NDArray[np.int64], rate_hz: float) -> tuple[Span, ...]:
    """Spans in frames with these times (F,) -> the same in frames of `at_even_rate`; none that has no frame there."""
    ends = np.append(at_ns, at_ns[-1] + SECOND_NS / rate_hz) - at_ns[0]
    frames = np.ceil(ends * rate_hz / SECOND_NS - 1e-6).astype(np.int64)
    moved = (replace(span, start=int(frames[span.start]), end=int(frames[span.end])) for span in spans)
    return tuple(span for span in moved if span.start < span.end)
