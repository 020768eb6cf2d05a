"""Recordings on another clock: at another sampling rate, or performed faster or slower; pure."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.motion.archive import Recording, Span

_SAME_INSTANT = 1e-6
"""Frames: instants nearer than this are one, so that rounding makes no frame depend on a not-seen neighbour."""


def resample(recording: Recording, rate_hz: float) -> Recording:
    """The same movement sampled at `rate_hz`, linear in time, part by part.

    The first frame stays the first; the last is the last that falls within the recording. A part is seen in a new
    frame only when it is seen in both frames around that instant. A span too short for any new frame is dropped.
    Raises BadInput for a rate that is not positive and finite.
    """
    _check_positive("rate_hz", rate_hz)
    step = recording.rate_hz / rate_hz
    count = math.floor((len(recording.positions) - 1) / step + _SAME_INSTANT) + 1
    return _sampled(replace(recording, rate_hz=rate_hz), step, count)


def retime(recording: Recording, tempo: float) -> Recording:
    """The same movement performed `tempo` times as fast (1.7: in 1/1.7 of the time), at the same rate.

    At least 2 frames, the first and the last when there is no room for more. Seen parts and spans as in `resample`.
    Raises BadInput for a tempo that is not positive and finite.
    """
    _check_positive("tempo", tempo)
    count = math.floor((len(recording.positions) - 1) / tempo + _SAME_INSTANT) + 1
    return _sampled(recording, tempo, max(count, 2))


def _check_positive(name: str, number: float) -> None:
    if not (math.isfinite(number) and number > 0):
        raise BadInput(f"{name} = {number}: a positive, finite number is expected")


def _sampled(recording: Recording, step: float, count: int) -> Recording:
    """`count` frames, each `step` old frames after the one before, spans with them."""
    instants = np.minimum(np.arange(count) * step, len(recording.positions) - 1)
    spans = (
        Span(_first_from(span.start, step), min(_first_from(span.end, step), count), span.label)
        for span in recording.spans
    )
    return replace(
        recording,
        positions=_interpolated(recording.positions, instants),
        spans=tuple(span for span in spans if span.start < span.end),
    )


def _first_from(frame: int, step: float) -> int:
    """The first new frame at or after the instant of old frame `frame`."""
    return math.ceil(frame / step - _SAME_INSTANT)


def _interpolated(positions: NDArray[np.float32], instants: NDArray[np.float64]) -> NDArray[np.float32]:
    """positions (F, P, 3), instants (K,) in frames, 0 to F-1 -> (K, P, 3); NaN beside any not-seen neighbour."""
    before = np.floor(instants + _SAME_INSTANT).astype(np.int64)
    weight = instants - before
    weight[np.abs(weight) < _SAME_INSTANT] = 0.0
    # An instant that is a frame needs no second neighbour: what is not seen there must not reach it.
    after = np.where(weight > 0, np.minimum(before + 1, len(positions) - 1), before)
    w = weight[:, None, None]
    between = (1 - w) * positions[before] + w * positions[after]
    between[~np.isfinite(between).all(axis=2)] = np.nan
    return between.astype(np.float32)
