"""A new recording beside those that an archive already has; pure."""

from dataclasses import replace

from common.errors import BadInput
from observer.motion.archive import LABEL_RULE, MotionArchive, Recording, is_label


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
