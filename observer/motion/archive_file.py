"""Reads and writes motion archives: .npz files without pickles, checked by the rules of the contract."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.files import write_arrays
from observer.motion.archive import MotionArchive, Recording, Span, check_archive

Arrays = dict[str, NDArray[Any]]

_NEEDED = ("positions", "lengths", "rate_hz", "body_parts", "labels", "subjects", "trials")
_SPANS = ("span_recording", "span_start", "span_end", "span_label")
_DTYPES = {"positions": "float32", "rate_hz": "float64", **dict.fromkeys(("lengths", *_SPANS[:3]), "int64")}
"""All other arrays contain text."""


def read_archive(path: Path) -> MotionArchive:
    """The motion archive in the .npz file at `path`; nothing in it is ever unpickled.

    Raises BadInput, one line with the file, the array, recording or frame and what is expected, for a file that is
    missing, empty, truncated, of another format, or that breaks a rule of the contract.
    """
    arrays = _load(path)
    for name in arrays:
        _check_dtype(path, name, arrays[name])
    _check_shapes(path, arrays)
    spans = _spans(path, arrays)
    lengths = arrays["lengths"]
    rates = np.broadcast_to(arrays["rate_hz"], lengths.shape)
    ends = np.cumsum(lengths)
    positions = arrays["positions"].astype(np.float32, copy=False)
    recordings = tuple(
        Recording(
            positions=positions[end - length : end],
            rate_hz=float(rates[number]),
            label=str(arrays["labels"][number]),
            subject=str(arrays["subjects"][number]),
            trial=str(arrays["trials"][number]),
            spans=spans[number],
        )
        for number, (end, length) in enumerate(zip(ends, lengths, strict=True))
    )
    archive = MotionArchive(tuple(map(str, arrays["body_parts"])), recordings)
    check_archive(archive, str(path))
    return archive


def write_archive(path: Path, archive: MotionArchive) -> None:
    """Write `archive` to the .npz file at `path`, completely or not at all.

    Raises BadInput if the archive breaks a rule of the contract, BadInput or LabanmeshError as `write_arrays` does.
    """
    check_archive(archive, f"{path}: not written")
    write_arrays(path, _arrays(archive), compressed=False)


def _load(path: Path) -> Arrays:
    """All arrays that the contract names; the span arrays are optional."""
    _check_is_zip(path)
    arrays: Arrays = {}
    name = "the list of arrays"
    try:
        # Opened here: numpy leaves a broken zip open.
        with path.open("rb") as content, np.load(content, allow_pickle=False) as file:
            for name in _names(path, set(file.files)):
                arrays[name] = file[name]
                if not isinstance(arrays[name], np.ndarray):
                    raise ValueError("not an array")
    except BadInput:
        raise
    # The errors of zipfile, zlib and numpy for broken files have no common base class.
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise BadInput(f"{path}: {name} cannot be read ({reason}); an array without pickles is expected") from error
    return arrays


def _check_is_zip(path: Path) -> None:
    try:
        whole = zipfile.is_zipfile(path)
        with path.open("rb") as file:
            start = file.read(4)
    except OSError as error:
        raise BadInput(f"{path}: cannot be read: {error.strerror or error}; a motion archive is expected") from error
    if not start:
        raise BadInput(f"{path}: is empty; a motion archive (.npz) is expected")
    if not whole and start.startswith(b"PK"):
        raise BadInput(f"{path}: is truncated: its table of contents is missing; a whole motion archive is expected")
    if not whole:
        raise BadInput(f"{path}: is not a motion archive: an .npz file (a zip of arrays) is expected")


def _names(path: Path, present: set[str]) -> tuple[str, ...]:
    wanted = _NEEDED + _SPANS if present.intersection(_SPANS) else _NEEDED
    missing = [name for name in wanted if name not in present]
    if missing:
        raise BadInput(f"{path}: array {missing[0]} is missing; expected: {', '.join(wanted)}")
    return wanted


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
    frames = arrays["positions"].shape[0] if arrays["positions"].ndim else 0
    expected["positions"] = (frames, arrays["body_parts"].size, 3)
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
        raise BadInput(f"{path}: lengths sum to {total}: {frames} is expected, the frames in positions")


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
    arrays: Arrays = {
        "positions": np.concatenate([recording.positions for recording in recordings]),
        "lengths": np.array([len(recording.positions) for recording in recordings], np.int64),
        "rate_hz": rates[0] if (rates == rates[0]).all() else rates,
        "body_parts": np.array(archive.body_parts, np.str_),
        "labels": np.array([recording.label for recording in recordings], np.str_),
        "subjects": np.array([recording.subject for recording in recordings], np.str_),
        "trials": np.array([recording.trial for recording in recordings], np.str_),
    }
    spans = [(number, span) for number, recording in enumerate(recordings) for span in recording.spans]
    if spans:
        indices = np.array([(number, span.start, span.end) for number, span in spans], np.int64)
        arrays |= dict(zip(_SPANS, indices.T, strict=False))
        arrays["span_label"] = np.array([span.label for _, span in spans], np.str_)
    return arrays
