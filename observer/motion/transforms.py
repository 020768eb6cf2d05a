"""Transforms of recordings: select, cut into single movements, resample to another rate, and change the tempo. Pure."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from common.text import nearest
from observer.motion.archive import MotionArchive, Recording, Span

_SAME_INSTANT = 1e-6
"""Frames: closer instants are one, so that rounding makes no frame depend on a missing neighbour."""


def select(archive: MotionArchive, subjects: Sequence[str] = (), rate_hz: float | None = None) -> MotionArchive:
    """The recordings of these subjects (default: all), resampled to this rate (default: their own).

    Raises BadInput for a subject that is not in the archive.
    """
    known = sorted({r.subject for r in archive.recordings})
    for subject in subjects:
        if subject not in known:
            raise BadInput(f"subject {subject!r}: not in the archive; it has {', '.join(known)}")
    recordings = [r for r in archive.recordings if not subjects or r.subject in subjects]
    if rate_hz is not None:
        recordings = [r if r.rate_hz == rate_hz else resample(r, rate_hz) for r in recordings]
    return MotionArchive(archive.body_parts, tuple(recordings))


def movements_in(archive: MotionArchive) -> Iterator[Recording]:
    """Recordings of one movement each: continuous recordings are cut at their spans."""
    for recording in archive.recordings:
        if not recording.spans:
            yield recording
        for n, span in enumerate(recording.spans):
            piece = recording.positions[span.start : span.end]
            yield Recording(piece, recording.rate_hz, span.label, recording.subject, f"{recording.trial}.{n}")


def labels_of(archive: MotionArchive) -> tuple[str, ...]:
    """All labels in the archive, in order of first appearance."""
    return tuple(dict.fromkeys(r.label for r in movements_in(archive) if r.label))


def require_labels(labels: Sequence[str], archive: MotionArchive, option: str) -> None:
    """Raise BadInput, with a suggestion, for the first label that no recording of the archive shows."""
    known = labels_of(archive)
    for label in labels:
        if label not in known:
            raise BadInput(f"{option} {label}: no recording shows this movement; {nearest(label, known)}")


def common_rate(archive: MotionArchive) -> float:
    """The rate of all recordings, in Hz; raises BadInput if they differ."""
    rates = sorted({recording.rate_hz for recording in archive.recordings})
    if len(rates) > 1:
        raise BadInput(f"recordings at {rates[0]:g} and {rates[-1]:g} Hz: bring them to one rate with --rate")
    return rates[0]


def resample(recording: Recording, rate_hz: float) -> Recording:
    """The same movement sampled at `rate_hz`, linear in time, part by part.

    The first frame stays the first; the last is the last one within the recording. A part is seen in a new frame if
    it is seen in both frames around that instant. A span too short for any new frame is dropped. Raises BadInput for a
    rate that is not positive and finite.
    """
    _check_positive("rate_hz", rate_hz)
    step = recording.rate_hz / rate_hz
    count = math.floor((len(recording.positions) - 1) / step + _SAME_INSTANT) + 1
    return _sampled(replace(recording, rate_hz=rate_hz), step, count)


def retime(recording: Recording, tempo: float) -> Recording:
    """The same movement performed `tempo` times as fast (1.7: in 1/1.7 of the time), at the same rate.

    Has at least 2 frames, the first and the last. Missing parts and spans are treated as in `resample`.
    Raises BadInput for a tempo that is not positive and finite.
    """
    _check_positive("tempo", tempo)
    count = math.floor((len(recording.positions) - 1) / tempo + _SAME_INSTANT) + 1
    return _sampled(recording, tempo, max(count, 2))


def _check_positive(name: str, number: float) -> None:
    if not (math.isfinite(number) and number > 0):
        raise BadInput(f"{name} = {number}: a positive, finite number is expected")


def _sampled(recording: Recording, step: float, count: int) -> Recording:
    """`count` frames at intervals of `step` old frames, with their spans."""
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
    """positions (F, P, 3), instants (K,) in frames, 0 to F-1 -> (K, P, 3); NaN next to a missing neighbour."""
    before = np.floor(instants + _SAME_INSTANT).astype(np.int64)
    weight = instants - before
    weight[np.abs(weight) < _SAME_INSTANT] = 0.0
    # An instant on a frame needs no second neighbour, which may be missing.
    after = np.where(weight > 0, np.minimum(before + 1, len(positions) - 1), before)
    w = weight[:, None, None]
    between = (1 - w) * positions[before] + w * positions[after]
    between[~np.isfinite(between).all(axis=2)] = np.nan
    return between.astype(np.float32)
