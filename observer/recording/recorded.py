"""One new recording of a motion archive: its name, its positions and a quality report; pure."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from common.errors import BadInput
from observer.calibration.triangulate import GATE_PX
from observer.motion.archive import LABEL_RULE, MotionArchive, Recording, is_label
from observer.recording.reconstruction import (
    FRONT,
    UP,
    CameraTracks,
    Reconstruction,
    closed,
    instants,
    moving_span,
    reconstruct,
    sampled,
    to_performer_axes,
    without_spikes,
)
from observer.tracks import Floats


def completed(name: Recording, archive: MotionArchive | None, body_parts: tuple[str, ...], place: str) -> Recording:
    """`name`, still without positions, with a trial: its own, or the next free number. Asked before anybody performs.

    Raises BadInput, naming `place`, for an archive of other body parts, of another rate, or that has this trial, and
    for a label or a subject that is none.
    """
    if not name.label or not is_label(name.label):
        raise BadInput(f"--label {name.label!r}: {LABEL_RULE}, and not empty")
    if not name.subject.strip() or not name.subject.isprintable():
        raise BadInput(f"--subject {name.subject!r}: who performs, in printable characters")
    if archive is None:
        return replace(name, trial=name.trial or "1")
    if archive.body_parts != body_parts:
        theirs, ours = ", ".join(archive.body_parts), ", ".join(body_parts)
        raise BadInput(f"{place}: holds {theirs}, this records {ours}; name another file")
    other = next((r.rate_hz for r in archive.recordings if r.rate_hz != name.rate_hz), None)
    if other is not None:
        raise BadInput(f"{place}: at {other:g} Hz; give --rate {other:g}, or name another file")
    there = [r.trial for r in archive.recordings if (r.label, r.subject) == (name.label, name.subject)]
    if name.trial in there:
        raise BadInput(f"{place}: has trial {name.trial} of {name.label} by {name.subject}; leave out --trial")
    return replace(name, trial=name.trial or str(max((int(t) for t in there if t.isdecimal()), default=0) + 1))


def appended(archive: MotionArchive | None, body_parts: tuple[str, ...], recording: Recording) -> MotionArchive:
    """The archive with one recording more, or a new one with this alone."""
    return MotionArchive(body_parts, (*(archive.recordings if archive else ()), recording))


OUTVOTED = 0.1
"""A camera that contradicts the others more often than this is worth a line of its own."""


def summary(names: Sequence[str], body_parts: Sequence[str], reconstruct: Reconstruction, final: Floats) -> list[str]:
    """One line for all, one more for each camera that had little say; final: (K, P, 3) the positions, mended."""
    whole = np.logical_and.reduce(np.isfinite(final), axis=-1)
    seen = ", ".join(f"{part} {share:.0%}" for part, share in zip(body_parts, whole.mean(axis=0), strict=True))
    errors = reconstruct.errors_px[reconstruct.used]
    exactness = f"median reprojection error {np.median(errors):.1f} px" if len(errors) else "no position found"
    head = f"all parts in {whole.all(axis=1).mean():.0%} of {len(final)} instants ({seen}); {exactness}"
    return [head, *filter(None, (_camera(n, name, reconstruct) for n, name in enumerate(names)))]


def rejected(reconstruct: Reconstruction) -> Floats:
    """(N,) of what each camera saw and others placed, the share in which it was outvoted; NaN where there is none."""
    found = np.isfinite(reconstruct.positions).all(axis=-1, keepdims=True)
    judged = reconstruct.seen & found
    outvoted = (judged & ~reconstruct.used).sum(axis=(0, 1))
    total = judged.sum(axis=(0, 1))
    return np.where(total > 0, outvoted / np.maximum(total, 1), np.nan)


def _camera(n: int, name: str, reconstruct: Reconstruction) -> str:
    if not reconstruct.seen[..., n].any():
        return f"{name}: saw no part at all; labanmesh look shows what its tracker finds"
    share = rejected(reconstruct)[n]
    if np.isnan(share):
        return f"{name}: agrees with no other camera; look at its calibration"
    if share > OUTVOTED:
        return f"{name}: rejected in {share:.0%} of what it saw; look at its calibration and at what its tracker finds"
    return ""


Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class RecordingOptions:
    """gate_px: a camera further off is outvoted. up, front: axes of the room. trim: whether idle ends are cut off."""

    gate_px: float = GATE_PX
    up: str = UP
    front: str = FRONT
    trim: bool = False


def recorded(
    sighted: Sequence[CameraTracks],
    body_parts: Sequence[str],
    name: Recording,
    choices: RecordingOptions,
    progress: Progress = lambda *_: None,
) -> tuple[Recording, list[str]]:
    """`name` with the positions that the cameras agree on, at its own rate; and lines that say how good they are.

    Raises BadInput when there is no common time, or no part at any instant, with those lines.
    """
    at_ns = instants(sighted, name.rate_hz)
    known = [one for one in sighted if len(one.at_ns)]
    centres = np.stack([sampled(one, at_ns) for one in known], axis=2)
    found = reconstruct([one.matrix for one in known], centres, choices.gate_px, progress)
    positions = closed(without_spikes(found.positions, name.rate_hz), name.rate_hz)
    positions = to_performer_axes(positions, choices.up, choices.front)
    lines = summary([one.name for one in known], body_parts, found, positions)
    lines += [f"{one.name}: delivered no picture" for one in sighted if not len(one.at_ns)]
    if not np.isfinite(positions).any():
        raise BadInput(f"nothing was recorded: {'; '.join(lines)}")
    if choices.trim:
        hands = [row for row, part in enumerate(body_parts) if part.endswith("hand")]
        positions = positions[slice(*moving_span(positions, hands, name.rate_hz))]
    return replace(name, positions=positions.astype(np.float32)), lines
