"""Which recorded movements are periodic, and how the repetitions of sets of ten are counted by people left out."""

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.command_line import markdown_table, recordings_folder, run_command
from common.config_sections import FusionConfig
from common.posterior import Repeated
from fusion.engine.aged_posterior import AgedPosterior
from fusion.engine.segments import RepetitionCount, pooled_repetitions
from observer.features import read_trace
from observer.geometry.views import parse_view
from observer.model.movement_segment import RepetitionCounter
from observer.model.periodicity import Oscillation, oscillation_of, with_other_side
from observer.motion.archive import MotionArchive, Recording, movements_in
from observer.motion.archive_file import read_archive
from observer.motion.importers import import_recordings
from observer.motion.projected import view_tracks
from observer.tracks import Floats

PAIR = ("door", "wheel")
FOUR = ("door", "wheel", "yaw:180", "yaw:270")
FRESH_S, FADE_S = FusionConfig().fresh_s, FusionConfig().fade_s
"""A frozen observer fades by them."""
EVERY = 8
"""Frames between two counts that are compared where only the last one matters."""
Counts = Sequence[AgedPosterior]


class _Take(NamedTuple):
    """A recording as the traces of its tracks, by view. ends: the frames at which its repetitions end, if known."""

    label: str
    subject: str
    trial: str
    traces: Mapping[str, Floats]
    ends: tuple[int, ...] = ()

    @property
    def is_correct(self) -> bool:
        """Whether UI-PRMD says that it is done as it should be."""
        return not self.trial.endswith("_inc")


@dataclass(frozen=True)
class _CountedSet:
    """What each view counts at each frame of a set, and the truth."""

    take: _Take
    counts: Mapping[str, Counts]
    rate_hz: float

    def fused(self, views: Sequence[str], every: int = 1, faulty: str = "", fault: str = "") -> list[RepetitionCount]:
        """The pooled count at each frame, or some; it never goes back. fault: of the view `faulty`, by its name."""
        best, course = RepetitionCount(0), []
        frames = len(next(iter(self.counts.values())))
        for n in (*range(0, frames, every), frames - 1):
            each = [self.counts[view][n] for view in views if view != faulty]
            if faulty:
                each.append(FAULTS[fault](n, self.counts[faulty], self.rate_hz))
            best = max(best, pooled_repetitions(each) or best)
            course.append(best)
        return course


def repetitions() -> None:
    """Print which movements are periodic, and the errors of the counts.

    LABANMESH_DATA names the folder of recordings.

    Example: python -m benchmarks.repetitions
    """
    data = recordings_folder()
    archive = read_archive(data / "ui_prmd" / "sets.npz")
    print("\n".join(_counted(archive)))
    print()
    rows = [row for name, archive in _archives(data) for row in _periodic(name, archive)]
    print(markdown_table(("movement", "set", "takes", "period, s"), rows, left=2))


def _archives(data: Path) -> Iterable[tuple[str, MotionArchive]]:
    yield "MSR Action3D", import_recordings("msr-action3d", data / "msr_action3d").archive
    yield "Florence 3D", import_recordings("florence3d", data / "florence3d").archive
    for name, file in (("karate", "karate"), ("nw_ucla", "sensor1"), ("kinder_gator", "adults")):
        yield name, read_archive(data / name / f"{file}.npz")


def _take(archive: MotionArchive, recording: Recording, label: str, views: Sequence[str]) -> _Take:
    parts = archive.body_parts
    tracks = {view: view_tracks(parse_view(view), recording, parts, parts) for view in views}
    traces = {view: read_trace(parts, recording.rate_hz, each).astype(float) for view, each in tracks.items()}
    ends = tuple(span.end for span in recording.spans)
    return _Take(label, recording.subject, recording.trial, traces, ends)


def _periodic(name: str, archive: MotionArchive) -> Iterable[Sequence[str]]:
    rate_hz, table = archive.recordings[0].rate_hz, dict[str, list[Floats]]()
    for recording in movements_in(archive):
        take = _take(archive, recording, recording.label, PAIR[:1])
        table.setdefault(take.label, []).append(take.traces["door"])
    for label, traces in table.items():
        oscillation = oscillation_of(traces, rate_hz)
        if oscillation is not None:
            yield label, name, str(len(traces)), f"{oscillation.period_s:.2f}"


def _counted(archive: MotionArchive) -> Iterable[str]:
    """Tables: counts of two views for each exercise; with one faulty view of four."""
    takes = [_take(archive, r, r.spans[0].label, FOUR) for r in archive.recordings]
    rate_hz = archive.recordings[0].rate_hz

    @cache
    def shown_by_others(view: str, label: str, who: str) -> Oscillation | None:
        own = [t.traces[view] for t in takes if t.label == label and t.subject != who]
        oscillation = oscillation_of(own, rate_hz)
        return None if oscillation is None else with_other_side(oscillation, archive.body_parts)

    watched = []
    for take in takes:
        known = {view: shown_by_others(view, take.label, take.subject) for view in FOUR}
        watched.append(
            _CountedSet(take, {v: _course(v, o, take.traces[v], rate_hz) for v, o in known.items()}, rate_hz)
        )
    yield from _by_exercise(watched)
    yield ""
    yield from _with_faults(watched)


def _course(view: str, oscillation: Oscillation | None, trace: Floats, rate_hz: float) -> Counts:
    """What one view counts, frame by frame."""
    if oscillation is None:
        return [AgedPosterior(view, np.ones(1), 0.0, 0.0, "counted")] * len(trace)
    counter, counts = RepetitionCounter({0: oscillation}, rate_hz), []
    for row in trace.astype(np.float32):
        counter.update(row, resting=False)
        count, more = counter.count(0), counter.repeated(0)
        counts.append(AgedPosterior(view, np.ones(1), 0.0, 0.0, "counted", repetitions=count, repeated=more))
    return counts


def _by_exercise(watched: Sequence[_CountedSet]) -> Iterable[str]:
    rows, errors, late_s, partial = [], [], list[float](), {True: [0, 0], False: [0, 0]}
    for label in dict.fromkeys(each.take.label for each in watched):
        own = [each for each in watched if each.take.label == label]
        of_label, late = [], list[float]()
        for each in own:
            course, ends = each.fused(PAIR), each.take.ends
            of_label.append(course[-1].done - len(ends))
            late += _delays_s(course, ends, each.rate_hz)
            sums = partial[each.take.is_correct]
            sums[0], sums[1] = sums[0] + course[-1].partial, sums[1] + course[-1].done
        errors += of_label
        late_s += late
        rows.append([label, *_shares(of_label), f"{np.median(late):+.2f}", ", ".join(f"{e:+d}" for e in of_label if e)])
    rows.append(["all", *_shares(errors), f"{np.median(late_s):+.2f}", ""])
    yield markdown_table(("exercise", "sets", "exact", "within 1", "late, s (median)", "errors"), rows)
    for correct, (few, of) in partial.items():
        yield f"partial repetitions told in {'correct' if correct else 'incorrect'} sets: {few} of {of}"


def _shares(errors: Sequence[int]) -> tuple[str, str, str]:
    off = np.abs(errors)
    return str(len(off)), f"{(off == 0).mean():.0%}", f"{(off <= 1).mean():.0%}"


def _delays_s(course: Sequence[RepetitionCount], ends: Sequence[int], rate_hz: float) -> list[float]:
    """From the end of each repetition to its count; negative: before, because it counts from its turning point on."""
    counts = np.array([each.done for each in course])
    reached = [int((counts > n).argmax()) for n in range(len(ends)) if counts[-1] > n]
    return [(at - end) / rate_hz for at, end in zip(reached, ends, strict=False)]


def _with_faults(watched: Sequence[_CountedSet]) -> Iterable[str]:
    """Each of four views in turn is faulty; the rates of exact counts, and without that view."""
    rows = []
    for fault in FAULTS:
        for faulty in FOUR:
            others = [view for view in FOUR if view != faulty]
            with_it = np.array([each.fused(FOUR, EVERY, faulty, fault)[-1].done for each in watched])
            without = np.array([each.fused(others, EVERY)[-1].done for each in watched])
            truth = np.array([len(each.take.ends) for each in watched])
            rates = (f"{(counts == truth).mean():.0%}" for counts in (with_it, without))
            rows.append([fault, faulty, *rates, str(int((with_it != without).sum()))])
    yield markdown_table(("fault", "of", "exact", "without it", "differ"), rows, left=2)


def _blind(n: int, counts: Counts, rate_hz: float) -> AgedPosterior:
    return AgedPosterior(counts[n].observer, np.ones(1), 1.0, None, "silent", freshness=0.0)


def _frozen(n: int, counts: Counts, rate_hz: float) -> AgedPosterior:
    stopped = counts[min(n, len(counts) // 2)]
    age_s = max(n - len(counts) // 2, 0) / rate_hz
    return _with(stopped, stopped.repetitions, float(np.exp(-max(age_s - FRESH_S, 0.0) / FADE_S)))


def _lying(n: int, counts: Counts, rate_hz: float) -> AgedPosterior:
    return _with(counts[n], 1000.0, 1.0, Repeated(partial=1000.0, swing=1e9))


def _with(
    each: AgedPosterior, count: float | None, freshness: float, repeated: Repeated | None = None
) -> AgedPosterior:
    return AgedPosterior(
        each.observer, each.p, each.rest, each.age_s, "counted", freshness=freshness, repetitions=count,
        repeated=repeated or each.repeated,
    )  # fmt: skip


FAULTS: Mapping[str, Callable[[int, Counts, float], AgedPosterior]] = {
    "blind": _blind, "frozen": _frozen, "lying": _lying,
}  # fmt: skip


if __name__ == "__main__":
    sys.exit(run_command(repetitions, "repetitions"))
