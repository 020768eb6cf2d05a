"""Reads and writes motion archives: .npz files without pickles, checked by the rules of the contract.

A file with `positions` holds motion in space, one with `tracks` the 2-D tracks of one camera.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common import SECOND_NS
from common.errors import BadInput
from observer.files import SHARED, read_arrays, write_arrays
from observer.motion.archive import (
    HIGHEST_RATE_HZ,
    LOWEST_RATE_HZ,
    MotionArchive,
    Recording,
    Span,
    TracksCamera,
    check_archive,
)
from observer.prepared_tracks import at_even_rate, spans_at_even_rate

Arrays = dict[str, NDArray[Any]]

POSITIONS, TRACKS, CAMERA, TIMES = "positions", "tracks", "camera", "times_s"
_NEEDED_ARRAYS = ("lengths", "rate_hz", "body_parts", "labels", "subjects", "trials")
_SPANS = ("span_recording", "span_start", "span_end", "span_label")
_DTYPES = {
    **dict.fromkeys((POSITIONS, TRACKS), "float32"),
    **dict.fromkeys(("rate_hz", TIMES), "float64"),
    **dict.fromkeys(("lengths", *_SPANS[:3]), "int64"),
}
"""All other arrays contain text."""
_LAST_AXIS = {POSITIONS: 3, TRACKS: 2}
MOST_FRAMES = 10_000_000
LONGEST_RECORDING_S = 86400.0
"""Of a recording with times: longer ones would hide a wrong unit, and take all memory at an even rate."""


def read_archive(path: Path) -> MotionArchive:
    """The motion archive in the .npz file at `path`; nothing in it is ever unpickled.

    Raises BadInput, one line with the file, the array, recording or frame and what is expected, for a file that is
    missing, empty, truncated, of another format, or that breaks a rule of the contract.
    """
    arrays = _load(path)
    for name in arrays:
        _check_dtype(path, name, arrays[name])
    _check_shapes(path, arrays)
    content = _content_of(arrays)
    recordings = _recordings(path, arrays, arrays[content].astype(np.float32, copy=False))
    camera = TracksCamera(str(arrays.get(CAMERA, ""))) if content == TRACKS else None
    archive = MotionArchive(tuple(map(str, arrays["body_parts"])), recordings, camera)
    check_archive(archive, str(path))
    if TIMES in arrays:
        archive = replace(archive, recordings=_at_even_rate(path, recordings, arrays[TIMES]))
        check_archive(archive, str(path))
    return archive


def _recordings(path: Path, arrays: Arrays, positions: NDArray[np.float32]) -> tuple[Recording, ...]:
    spans = _spans(path, arrays)
    lengths = arrays["lengths"]
    rates = np.broadcast_to(arrays["rate_hz"], lengths.shape)
    return tuple(
        Recording(
            positions=positions[end - length : end],
            rate_hz=float(rates[number]),
            label=str(arrays["labels"][number]),
            subject=str(arrays["subjects"][number]),
            trial=str(arrays["trials"][number]),
            spans=spans[number],
        )
        for number, (end, length) in enumerate(zip(np.cumsum(lengths), lengths, strict=True))
    )


def _at_even_rate(path: Path, recordings: tuple[Recording, ...], times_s: NDArray[np.float64]) -> tuple[Recording, ...]:
    """The same recordings, whose frames have these times (F,), at their nominal rates."""
    result, begin = [], 0
    for number, recording in enumerate(recordings):
        end = begin + len(recording.positions)
        at_s = times_s[begin:end] - times_s[begin]
        rising = np.isfinite(at_s).all() and (np.diff(at_s) > 0).all() and at_s[-1] < LONGEST_RECORDING_S
        rate_fits = LOWEST_RATE_HZ <= recording.rate_hz <= HIGHEST_RATE_HZ
        if not (rising and rate_fits and at_s[-1] * recording.rate_hz <= MOST_FRAMES):
            raise BadInput(
                f"{path}: {TIMES}, recording {number}: seconds that rise from frame to frame are expected, within "
                f"a day, and a positive rate_hz; at most {MOST_FRAMES:,} frames"
            )
        at_ns = np.round(at_s * SECOND_NS).astype(np.int64)
        centres = at_even_rate(at_ns, recording.positions.astype(np.float64), recording.rate_hz)
        spans = spans_at_even_rate(recording.spans, at_ns, recording.rate_hz)
        result.append(replace(recording, positions=centres, spans=spans))
        begin = end
    return tuple(result)


def write_archive(path: Path, archive: MotionArchive, mode: int = SHARED) -> None:
    """Write `archive` to the .npz file at `path`, completely or not at all.

    Raises BadInput if the archive breaks a rule of the contract, BadInput or LabanmeshError as `write_arrays` does.
    """
    check_archive(archive, f"{path}: not written")
    write_arrays(path, _arrays(archive), compressed=False, mode=mode)


def _load(path: Path) -> Arrays:
    """All arrays that the contract names; the span arrays are optional."""
    try:
        arrays = read_arrays(path)
    except FileNotFoundError:
        raise BadInput(f"{path}: cannot be read: no such file; name a motion archive (.npz)") from None
    except ValueError as error:
        raise BadInput(
            f"{path}: cannot be read ({error}); a whole motion archive is expected, without pickles"
        ) from None
    return {name: arrays[name] for name in _names(path, set(arrays))}


def _names(path: Path, present: set[str]) -> tuple[str, ...]:
    if present.issuperset(_LAST_AXIS):
        raise BadInput(
            f"{path}: has {POSITIONS} and {TRACKS}: one of them is expected, 3-D or the tracks of one camera"
        )
    content = TRACKS if TRACKS in present else POSITIONS
    wanted = (content, *_NEEDED_ARRAYS) + (_SPANS if present.intersection(_SPANS) else ())
    missing = [name for name in wanted if name not in present]
    if missing:
        raise BadInput(f"{path}: array {missing[0]} is missing; expected: {', '.join(wanted)}")
    return wanted + tuple(name for name in (CAMERA, TIMES) if content == TRACKS and name in present)


def _content_of(arrays: Arrays) -> str:
    return TRACKS if TRACKS in arrays else POSITIONS


def _check_dtype(path: Path, name: str, array: NDArray[Any]) -> None:
    expected = _DTYPES.get(name, "text")
    if array.dtype.kind != "U" if expected == "text" else array.dtype.newbyteorder("=") != np.dtype(expected):
        raise BadInput(f"{path}: {name} has type {array.dtype}: {expected} is expected")


def _check_shapes(path: Path, arrays: Arrays) -> None:
    """Check the shape of every array, and the lengths against the number of frames."""
    count = arrays["lengths"].size
    expected: dict[str, tuple[int, ...]] = {"lengths": (count,), "body_parts": (arrays["body_parts"].size,)}
    expected |= dict.fromkeys(("labels", "subjects", "trials"), (count,))
    if arrays["rate_hz"].ndim:
        expected["rate_hz"] = (count,)
    content = _content_of(arrays)
    frames = arrays[content].shape[0] if arrays[content].ndim else 0
    expected[content] = (frames, arrays["body_parts"].size, _LAST_AXIS[content])
    expected |= {name: shape for name, shape in ((CAMERA, ()), (TIMES, (frames,))) if name in arrays}
    if "span_label" in arrays:
        expected |= dict.fromkeys(_SPANS, (arrays["span_label"].size,))
    for name, shape in expected.items():
        if arrays[name].shape != shape:
            raise BadInput(
                f"{path}: {name} has shape {arrays[name].shape}: {shape} is expected beside the other arrays"
            )
    # One by one first: the sum of absurd lengths would overflow.
    for number, length in enumerate(arrays["lengths"]):
        if not 0 < length <= frames:
            raise BadInput(f"{path}: lengths, recording {number}: {length} frames; 1 to {frames} are expected")
    total = int(arrays["lengths"].sum())
    if total != frames:
        raise BadInput(f"{path}: lengths sum to {total}: {frames} is expected, the frames in {content}")


def _spans(path: Path, arrays: Arrays) -> tuple[tuple[Span, ...], ...]:
    """The spans of each recording by their start; the file may contain them in any order."""
    count = arrays["lengths"].size
    spans: list[list[Span]] = [[] for _ in range(count)]
    rows = zip(*(arrays[name] for name in _SPANS), strict=True) if "span_label" in arrays else ()
    for number, (recording, start, end, label) in enumerate(rows):
        if not 0 <= recording < count:
            raise BadInput(f"{path}: span_recording, span {number}: {recording}; 0 to {count - 1} is expected")
        spans[recording].append(Span(int(start), int(end), str(label)))
    return tuple(tuple(sorted(few, key=lambda span: (span.start, span.end))) for few in spans)


def _arrays(archive: MotionArchive) -> Arrays:
    recordings = archive.recordings
    rates = np.array([recording.rate_hz for recording in recordings], np.float64)
    content = POSITIONS if archive.camera is None else TRACKS
    arrays: Arrays = {
        content: np.concatenate([recording.positions for recording in recordings]),
        "lengths": np.array([len(recording.positions) for recording in recordings], np.int64),
        "rate_hz": rates[0] if (rates == rates[0]).all() else rates,
        "body_parts": np.array(archive.body_parts, np.str_),
        "labels": np.array([recording.label for recording in recordings], np.str_),
        "subjects": np.array([recording.subject for recording in recordings], np.str_),
        "trials": np.array([recording.trial for recording in recordings], np.str_),
    }
    if archive.camera is not None:
        arrays[CAMERA] = np.array(archive.camera.name, np.str_)
    spans = [(number, span) for number, recording in enumerate(recordings) for span in recording.spans]
    if spans:
        indices = np.array([(number, span.start, span.end) for number, span in spans], np.int64)
        arrays |= dict(zip(_SPANS, indices.T, strict=False))
        arrays["span_label"] = np.array([span.label for _, span in spans], np.str_)
    return arrays
