"""`python -m benchmarks.repetitions`: which movements of recorded people are repeated, and how well that is counted.

Whether a movement is periodic is decided from all its takes, as seen from the door. The sets of ui_prmd, of ten
repetitions each, are counted by what the other people's sets show.
"""

import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from benchmarks.command_line import markdown_table, recordings_folder, run_command
from observer.geometry.views import parse_view
from observer.model.body_trace import read_trace
from observer.model.periodicity import Oscillation, oscillation_of
from observer.model.repetitions import RepetitionCounter
from observer.motion.archive import MotionArchive, Recording, movements_in
from observer.motion.archive_file import read_archive
from observer.motion.importers import import_recordings
from observer.motion.projected import view_tracks
from observer.tracks import Floats

DOOR = parse_view("door")


class _Take(NamedTuple):
    """A recording as the trace of its tracks. repetitions: how many it holds; 0: not known."""

    label: str
    subject: str
    trial: str
    trace: Floats
    repetitions: int = 0


def repetitions() -> None:
    """Print which movements are periodic, and the errors of the counts.

    LABANMESH_DATA names the folder of recordings.

    Example: python -m benchmarks.repetitions
    """
    data = recordings_folder()
    rows = [row for name, archive in _archives(data) for row in _periodic(name, archive)]
    print(markdown_table(("movement", "set", "takes", "period, s"), rows, left=2))
    print()
    print("\n".join(_counted(read_archive(data / "ui_prmd" / "sets.npz"))))


def _archives(data: Path) -> Iterable[tuple[str, MotionArchive]]:
    yield "MSR Action3D", import_recordings("msr-action3d", data / "msr_action3d").archive
    yield "Florence 3D", import_recordings("florence3d", data / "florence3d").archive
    for name, file in (("karate", "karate"), ("nw_ucla", "sensor1"), ("kinder_gator", "adults")):
        yield name, read_archive(data / name / f"{file}.npz")


def _take(archive: MotionArchive, recording: Recording, label: str, count: int = 0) -> _Take:
    parts = archive.body_parts
    trace = read_trace(parts, recording.rate_hz, view_tracks(DOOR, recording, parts, parts))
    return _Take(label, recording.subject, recording.trial, trace.astype(float), count)


def _by_label(takes: Iterable[_Take]) -> dict[str, list[_Take]]:
    table: dict[str, list[_Take]] = {}
    for take in takes:
        table.setdefault(take.label, []).append(take)
    return table


def _periodic(name: str, archive: MotionArchive) -> Iterable[Sequence[str]]:
    rate_hz = archive.recordings[0].rate_hz
    for label, takes in _by_label(_take(archive, r, r.label) for r in movements_in(archive)).items():
        oscillation = oscillation_of([take.trace for take in takes], rate_hz)
        if oscillation is not None:
            yield label, name, str(len(takes)), f"{oscillation.period_s:.2f}"


def _counted(archive: MotionArchive) -> Iterable[str]:
    """For each exercise the errors of the counts and how often each occurs, then all together."""
    rate_hz, errors = archive.recordings[0].rate_hz, dict[bool, Counter[float]]()
    takes = _by_label(_take(archive, r, r.spans[0].label, len(r.spans)) for r in archive.recordings)
    rows = []
    for label, own in takes.items():
        shown = {who: _shown_by_others(own, who, rate_hz) for who in {take.subject for take in own}}
        of_label = {correct: _errors(own, shown, rate_hz, correct) for correct in (True, False)}
        rows.append([label, *(_histogram(of_label[correct]) for correct in (True, False))])
        for correct, counts in of_label.items():
            errors[correct] = errors.get(correct, Counter()) + counts
    yield markdown_table(("exercise", "correctly", "incorrectly"), rows)
    for correct, counts in errors.items():
        near = sum(n for error, n in counts.items() if abs(error) <= 1)
        yield f"{'correctly' if correct else 'incorrectly'}: within 1 in {near} of {counts.total()} sets"


def _shown_by_others(takes: Sequence[_Take], who: str, rate_hz: float) -> Oscillation | None:
    return oscillation_of([take.trace for take in takes if take.subject != who], rate_hz)


def _errors(
    takes: Sequence[_Take], shown: Mapping[str, Oscillation | None], rate_hz: float, correct: bool
) -> Counter[float]:
    """The counts less the truth; a movement that is not periodic is counted as 0."""
    errors = Counter[float]()
    for take in takes:
        oscillation = shown[take.subject]
        if take.trial.endswith("_inc") != correct:
            errors[(0.0 if oscillation is None else _count(oscillation, take.trace, rate_hz)) - take.repetitions] += 1
    return errors


def _count(oscillation: Oscillation, trace: Floats, rate_hz: float) -> float:
    counter = RepetitionCounter({0: oscillation}, rate_hz)
    for row in trace.astype("float32"):
        counter.update(row, resting=False)
    return counter.count(0) or 0.0


def _histogram(errors: Counter[float]) -> str:
    return ", ".join(f"{error:+g}: {n}" if error else f"0: {n}" for error, n in sorted(errors.items()))


if __name__ == "__main__":
    sys.exit(run_command(repetitions, "repetitions"))
