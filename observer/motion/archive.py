"""The motion archive: recordings of people as positions of body parts; its rules; resampling and cutting. Pure.

An archive holds positions in 3-D, or the 2-D tracks of one camera. The functions for 3-D positions (F, P, 3) work on
tracks (F, P, 2) as well.
"""

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from common.text import nearest

ARCHIVE_LABEL_RULE = "lower case letters, digits and underscores only"
_ARCHIVE_LABEL = re.compile(r"[a-z0-9_]*\Z")


@dataclass(frozen=True, slots=True)
class Span:
    """One movement inside a continuous recording: frames start..end-1 from the recording's start.

    trial: the trial of the recording that `movements_in` cuts out here; set by `streams_in`, not stored in archives.
    """

    start: int
    end: int
    label: str
    trial: str = ""


@dataclass(frozen=True, slots=True)
class Recording:
    """One recording of one person.

    positions: (F, P, 3) float32 metres; x to the performer's right, y up, z to the performer's back; or tracks
    (F, P, 2), u to the right, v down, any unit; NaN where not seen. label: the movement, or "" for several movements,
    which `spans` then name.
    """

    positions: NDArray[np.float32]
    rate_hz: float
    label: str
    subject: str
    trial: str
    spans: tuple[Span, ...] = ()


@dataclass(frozen=True, slots=True)
class TracksCamera:
    """The camera whose tracks an archive holds.

    name: the observer or camera, for people, "" if unknown; tracks of another name do not go into the same model.
    """

    name: str = ""


@dataclass(frozen=True, slots=True)
class MotionArchive:
    """Recordings that share their body parts: the P names, in the order of axis 1 of every `positions`.

    camera: the recordings are its 2-D tracks; None: they are 3-D positions.
    """

    body_parts: tuple[str, ...]
    recordings: tuple[Recording, ...]
    camera: TracksCamera | None = None


def is_label(text: str) -> bool:
    """Whether `text` may name a movement: [a-z0-9_]*; the empty label of a continuous recording included."""
    return _ARCHIVE_LABEL.match(text) is not None


def clean_label(text: str) -> str:
    """`text` as a label: lower case, every run of other characters one underscore, none at the ends, 64 at most."""
    return re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")[:64].rstrip("_")


LOWEST_RATE_HZ, HIGHEST_RATE_HZ = 0.01, 1e5
LARGEST = 1e12
"""Of a coordinate, larger than any metre, degree or second: the squares of larger ones would overflow float32."""


def check_archive(archive: MotionArchive, place: str = "archive") -> None:
    """Raise BadInput, one line beginning with `place`, for the first rule of the contract that `archive` breaks."""
    names = archive.body_parts
    if not names or not all(name and name.isprintable() for name in names) or len(set(names)) < len(names):
        raise BadInput(
            f"{place}: body_parts = {list(names)}: at least one name is expected, each different, none empty"
        )
    if not archive.recordings:
        raise BadInput(f"{place}: no recordings: at least one is expected")
    if archive.camera is not None and not archive.camera.name.isprintable():
        raise BadInput(f"{place}: camera {archive.camera.name!r}: printable characters are expected")
    for number, recording in enumerate(archive.recordings):
        check_recording(recording, len(names), f"{place}: recording {number}", 3 if archive.camera is None else 2)


def check_recording(recording: Recording, parts: int, place: str, axes: int = 3) -> None:
    """Raise BadInput, one line beginning with `place`, for the first rule of the contract that `recording` breaks.

    parts: P, the number of body parts that the positions must have; axes: 3 for positions, 2 for tracks. Frames are
    counted from 0.
    """
    if not LOWEST_RATE_HZ <= recording.rate_hz <= HIGHEST_RATE_HZ:
        raise BadInput(f"{place}: rate_hz = {recording.rate_hz}: a positive, finite rate up to 1e5 Hz is expected")
    if not is_label(recording.label):
        raise BadInput(f"{place}: label {recording.label!r}: {ARCHIVE_LABEL_RULE}")
    for name, text in (("subject", recording.subject), ("trial", recording.trial)):
        if not text.isprintable():
            raise BadInput(f"{place}: {name} {text!r}: printable characters are expected")
    _check_positions(recording.positions, (parts, axes), place)
    _check_spans(recording.spans, len(recording.positions), place)


def _check_positions(positions: NDArray[np.float32], shape: tuple[int, int], place: str) -> None:
    name, unit = ("positions", "metres") if shape[1] == 3 else ("tracks", "image coordinates")
    if positions.dtype != np.float32 or positions.ndim != 3 or positions.shape[1:] != shape or not len(positions):
        raise BadInput(
            f"{place}: {name} are {positions.dtype} {positions.shape}: "
            f"float32 (F, {shape[0]}, {shape[1]}) is expected, with at least one frame"
        )
    infinite = np.isinf(positions)
    if infinite.any():
        frame, part = np.argwhere(infinite)[0, :2]
        raise BadInput(
            f"{place}: {name}, frame {frame}, body part {part}: infinite; {unit} are expected, NaN where not seen"
        )
    if (positions > LARGEST).any() or (positions < -LARGEST).any():
        raise BadInput(f"{place}: {name} up to {np.nanmax(np.abs(positions)):g}: {unit} are expected")
    if not np.isfinite(positions).all(axis=2).any():
        raise BadInput(f"{place}: {name}: no body part is seen in any frame; leave the recording out")


def _check_spans(spans: tuple[Span, ...], length: int, place: str) -> None:
    free_from = 0
    for number, span in enumerate(spans):
        where = f"{place}: span {number}"
        if not span.label or not is_label(span.label):
            raise BadInput(f"{where}: label {span.label!r}: a movement's name is expected, {ARCHIVE_LABEL_RULE}")
        if not 0 <= span.start < span.end <= length:
            raise BadInput(f"{where}: frames {span.start} to {span.end}: 0 <= start < end <= {length} is expected")
        if span.start < free_from:
            raise BadInput(
                f"{where}: starts at frame {span.start}, before the span ahead of it ends at {free_from}: "
                "spans are expected in order, without overlap"
            )
        free_from = span.end


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
    return replace(archive, recordings=tuple(recordings))


def movements_in(archive: MotionArchive) -> Iterator[Recording]:
    """Recordings of one movement each: continuous recordings are cut at their spans."""
    for recording in archive.recordings:
        if not recording.spans:
            yield recording
        for n, span in enumerate(recording.spans):
            piece, trial = recording.positions[span.start : span.end], span.trial or f"{recording.trial}.{n}"
            yield Recording(piece, recording.rate_hz, span.label, recording.subject, trial)


def streams_in(archive: MotionArchive, labels: Sequence[str] = (), unlabelled: bool = False) -> Iterator[Recording]:
    """The continuous recordings: the frames outside their spans show something else than any movement.

    labels: the movements whose spans stay (default: all). A span of another movement is cut out, and the recording
    becomes several, so that this movement is neither learned nor taken for something else. unlabelled: also recordings
    without a label and without spans, as streams in which no movement happens. Every span names its trial, as
    `movements_in` does.
    """
    for recording in archive.recordings:
        if not recording.spans and (recording.label or not unlabelled):
            continue
        start = 0
        spans = tuple(replace(s, trial=s.trial or f"{recording.trial}.{n}") for n, s in enumerate(recording.spans))
        for span in spans:
            if labels and span.label not in labels:
                yield from _piece(recording, spans, start, span.start)
                start = span.end
        yield from _piece(recording, spans, start, len(recording.positions))


def _piece(recording: Recording, spans: Sequence[Span], start: int, end: int) -> Iterator[Recording]:
    """Frames start..end-1 with the spans within them; nothing if there are none."""
    if start < end:
        within = (s for s in spans if start <= s.start and s.end <= end)
        moved = tuple(replace(s, start=s.start - start, end=s.end - start) for s in within)
        yield replace(recording, positions=recording.positions[start:end], spans=moved)


def labels_of(archive: MotionArchive) -> tuple[str, ...]:
    """All labels in the archive, in order of first appearance."""
    return tuple(dict.fromkeys(r.label for r in movements_in(archive) if r.label))


def subjects_in(recordings: Iterable[Recording]) -> list[str]:
    """The people who perform in them, in order; numbers as numbers."""
    return sorted({recording.subject for recording in recordings}, key=lambda subject: (len(subject), subject))


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
        replace(span, start=_first_from(span.start, step), end=min(_first_from(span.end, step), count))
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
