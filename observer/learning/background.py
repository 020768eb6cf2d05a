"""Recordings of movements that are none of the vocabulary, by which a model knows "something else". Pure."""

from collections.abc import Sequence
from dataclasses import replace

from common.errors import BadInput
from observer.motion.archive import MotionArchive, Recording
from observer.motion.transforms import labels_of, movements_in, resample

BLENDS = "blends"
"""Said in place of recordings: blends of the learned movements alone are examples of something else."""


def gathered(
    archives: Sequence[MotionArchive], labels: Sequence[str], body_parts: tuple[str, ...], rate_hz: float
) -> MotionArchive:
    """All named recordings of the archives, or those of these movements, with these parts and at this rate.

    Raises BadInput for a body part that an archive lacks, and for a movement that no recording shows.
    """
    recordings = [_with_parts(r, archive, body_parts) for archive in archives for r in movements_in(archive) if r.label]
    found = MotionArchive(body_parts, tuple(resample(r, rate_hz) if r.rate_hz != rate_hz else r for r in recordings))
    known = labels_of(found)
    for label in labels:
        if label not in known:
            raise BadInput(f"--background-labels: {label!r} is in no recording; known: {', '.join(known)}")
    return MotionArchive(body_parts, tuple(r for r in found.recordings if not labels or r.label in labels))


def blends_alone(body_parts: tuple[str, ...]) -> MotionArchive:
    """No recordings: whoever learns with this background makes up what else there is."""
    return MotionArchive(body_parts, ())


def _with_parts(recording: Recording, archive: MotionArchive, body_parts: tuple[str, ...]) -> Recording:
    missing = [part for part in body_parts if part not in archive.body_parts]
    if missing:
        has = ", ".join(archive.body_parts)
        raise BadInput(f"background: no {missing[0]!r} in its recordings, which the model needs; they have {has} alone")
    places = [archive.body_parts.index(part) for part in body_parts]
    return replace(recording, positions=recording.positions[:, places])
