"""The motion archive: recordings of people as 3-D positions of body parts, and its rules. Pure."""

import math
import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput

LABEL_RULE = "lower case letters, digits and underscores only"
_LABEL = re.compile(r"[a-z0-9_]*\Z")


@dataclass(frozen=True, slots=True)
class Span:
    """One movement inside a continuous recording: frames start..end-1 from the recording's start."""

    start: int
    end: int
    label: str


@dataclass(frozen=True, slots=True)
class Recording:
    """One recording of one person.

    positions: (F, P, 3) float32 metres; x to the performer's right, y up, z to the performer's back; NaN where
    not seen. label: the movement, or "" for several movements, which `spans` then name.
    """

    positions: NDArray[np.float32]
    rate_hz: float
    label: str
    subject: str
    trial: str
    spans: tuple[Span, ...] = ()


@dataclass(frozen=True, slots=True)
class MotionArchive:
    """Recordings that share their body parts: the P names, in the order of axis 1 of every `positions`."""

    body_parts: tuple[str, ...]
    recordings: tuple[Recording, ...]


def is_label(text: str) -> bool:
    """Whether `text` may name a movement: [a-z0-9_]*; the empty label of a continuous recording included."""
    return _LABEL.match(text) is not None


def clean_label(text: str) -> str:
    """`text` as a label: lower case, every run of other characters one underscore, none at the ends, 64 at most."""
    return re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")[:64].rstrip("_")


def check_archive(archive: MotionArchive, place: str = "archive") -> None:
    """Raise BadInput, one line beginning with `place`, for the first rule of the contract that `archive` breaks."""
    names = archive.body_parts
    if not names or not all(name and name.isprintable() for name in names) or len(set(names)) < len(names):
        raise BadInput(
            f"{place}: body_parts = {list(names)}: at least one name is expected, each different, none empty"
        )
    if not archive.recordings:
        raise BadInput(f"{place}: no recordings: at least one is expected")
    for number, recording in enumerate(archive.recordings):
        check_recording(recording, len(names), f"{place}: recording {number}")


def check_recording(recording: Recording, parts: int, place: str) -> None:
    """Raise BadInput, one line beginning with `place`, for the first rule of the contract that `recording` breaks.

    parts: P, the number of body parts that the positions must have. Frames are counted from 0.
    """
    if not (math.isfinite(recording.rate_hz) and recording.rate_hz > 0):
        raise BadInput(f"{place}: rate_hz = {recording.rate_hz}: a positive, finite rate is expected")
    if not is_label(recording.label):
        raise BadInput(f"{place}: label {recording.label!r}: {LABEL_RULE}")
    for name, text in (("subject", recording.subject), ("trial", recording.trial)):
        if not text.isprintable():
            raise BadInput(f"{place}: {name} {text!r}: printable characters are expected")
    _check_positions(recording.positions, parts, place)
    _check_spans(recording.spans, len(recording.positions), place)


def _check_positions(positions: NDArray[np.float32], parts: int, place: str) -> None:
    if positions.dtype != np.float32 or positions.ndim != 3 or positions.shape[1:] != (parts, 3) or not len(positions):
        raise BadInput(
            f"{place}: positions are {positions.dtype} {positions.shape}: "
            f"float32 (F, {parts}, 3) is expected, with at least one frame"
        )
    infinite = np.isinf(positions)
    if infinite.any():
        frame, part = np.argwhere(infinite)[0, :2]
        raise BadInput(
            f"{place}: positions, frame {frame}, body part {part}: infinite; metres are expected, NaN where not seen"
        )
    if not np.isfinite(positions).all(axis=2).any():
        raise BadInput(f"{place}: positions: no body part is seen in any frame; leave the recording out")


def _check_spans(spans: tuple[Span, ...], length: int, place: str) -> None:
    free_from = 0
    for number, span in enumerate(spans):
        where = f"{place}: span {number}"
        if not span.label or not is_label(span.label):
            raise BadInput(f"{where}: label {span.label!r}: a movement's name is expected, {LABEL_RULE}")
        if not 0 <= span.start < span.end <= length:
            raise BadInput(f"{where}: frames {span.start} to {span.end}: 0 <= start < end <= {length} is expected")
        if span.start < free_from:
            raise BadInput(
                f"{where}: starts at frame {span.start}, before the span ahead of it ends at {free_from}: "
                "spans are expected in order, without overlap"
            )
        free_from = span.end
