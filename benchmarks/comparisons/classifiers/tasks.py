"""What `make peers` compares: the recordings, who learns and who is judged, and what each table says about it."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.comparisons.classifiers.comparison import (
    PEERS,
    Peer,
    PeerOptions,
    compare_peers,
    seen_by_all,
    seen_by_some,
)
from benchmarks.comparisons.classifiers.spotter import spot_streams
from benchmarks.comparisons.classifiers.tables import as_json, as_markdown, peer_rows, streams_as_markdown
from common.errors import BadInput
from observer.motion.archive import MotionArchive, labels_of, subjects_in
from observer.motion.archive_file import read_archive
from observer.motion.importers import import_recordings
from observer.motion.label_sets import SUBSETS
from observer.motion.projected import view_of
from observer.tracks import BODY_PARTS
from studies.evaluated_archives import ALL_PARTS, chosen_parts
from studies.observing import observe_folds
from studies.report import FRACTIONS
from studies.sensors import performances, read_sensors
from studies.settings import EvaluationSettings, Progress
from studies.stream import judge_observed

VIEWS = ("door", "wheel")
WITH_FEET = (*BODY_PARTS, "left_foot", "right_foot")
Parts = tuple[str, ...]
SPOTTER = "MiniRocket spotter"


@dataclass(frozen=True, slots=True)
class Table:
    """A finished table: a title, its protocol in a line, markdown, and the same as JSON."""

    title: str
    protocol: str
    markdown: str
    figures: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class AccuracyTask:
    """Accuracy after fractions of movements that are cut out. sets: settings by name of the set of movements.

    joint: peers that see all views of one archive as one series.
    """

    title: str
    protocol: str
    archive: MotionArchive
    sets: Mapping[str, EvaluationSettings]
    joint: Mapping[str, Peer]

    def run(self, options: PeerOptions, progress: Progress) -> Table:
        """Compare all classifiers on all sets."""
        comparisons = [
            compare_peers(self.archive, name, settings, options, progress, self.joint, PEERS["MiniRocket"])
            for name, settings in self.sets.items()
        ]
        settings = next(iter(self.sets.values()))
        if settings.sensors:
            comparisons = [
                one
                for each in comparisons
                for one in (seen_by_all(each, f"{each.movements}, seen by all sensors"), seen_by_some(each))
            ]
        rows = peer_rows(comparisons)
        people = sorted(set(comparisons[0].people), key=lambda name: (len(name), name))
        views = [view.name for view in settings.views]
        trials = ", ".join(f"{len(one.people)} of {one.movements}" for one in comparisons)
        facts = (
            f"{self.protocol} {'Sensors' if settings.sensors else 'Views'} {', '.join(views)}; "
            f"{_parts_text(settings.body_parts, self.archive)}; people judged: {', '.join(people)}; "
            f"trials: {trials}; seeds: {len(options.seeds)}."
        )
        figures = {"version": 1, "views": views, "judged": people, "seeds": len(options.seeds), "fast": options.fast}
        return Table(self.title, facts, as_markdown(rows, FRACTIONS), figures | {"rows": as_json(rows, FRACTIONS)})


@dataclass(frozen=True, slots=True)
class StreamTask:
    """Spotting in continuous recordings. sets: settings by name of what observers see."""

    title: str
    protocol: str
    archive: MotionArchive
    sets: Mapping[str, EvaluationSettings]

    def run(self, options: PeerOptions, progress: Progress) -> Table:
        """Judge all streams by our observers and by the spotter."""
        rows: list[dict[str, Any]] = []
        for name, settings in self.sets.items():
            watch = _under(progress, f"{name}: ours")
            if options.ours:
                folds = observe_folds(self.archive, settings, watch, options.jobs, trials=False, streams=True)
                ours = judge_observed(folds, settings, watch, options.jobs).as_json()
                rows.append({"observers": name, "judged_by": "ours, fused", **ours})
            theirs = spot_streams(self.archive, settings, options, partial(progress, f"{name}: {SPOTTER}"))
            rows.append({"observers": name, "judged_by": SPOTTER, **theirs.as_json()})
        streams = [recording for recording in self.archive.recordings if recording.spans]
        people = subjects_in(streams)
        facts = (
            f"{self.protocol} People judged: {', '.join(people)}; {len(streams)} streams with "
            f"{sum(len(stream.spans) for stream in streams)} movements."
        )
        figures = {"version": 1, "judged": people, "fast": options.fast, "rows": rows}
        return Table(self.title, facts, streams_as_markdown(rows), figures)


Task = AccuracyTask | StreamTask


def _under(progress: Progress, name: str) -> Progress:
    return lambda what, done, total: progress(f"{name}, {what}", done, total)


def sets_of(settings: EvaluationSettings) -> dict[str, EvaluationSettings]:
    """All movements and, where the archive has them, AS1, AS2 and AS3."""
    known = settings.labels
    subsets = {name: replace(settings, labels=some) for name, some in SUBSETS.items() if set(some) <= set(known)}
    return {f"all {len(known)}": settings, **subsets}


def _settings(
    archive: MotionArchive, leave_one_out: bool, parts: Parts, views: Sequence[str] = VIEWS
) -> EvaluationSettings:
    return EvaluationSettings(
        views=tuple(view_of(archive, view) for view in views),
        labels=labels_of(archive),
        leave_one_subject_out=leave_one_out,
        body_parts=chosen_parts(parts, archive.body_parts),
    )


def _parts_text(parts: Parts, archive: MotionArchive) -> str:
    return f"all {len(parts)} body parts" if parts == archive.body_parts else f"body parts {', '.join(parts)}"


def _of_all(title: str, protocol: str, archive: MotionArchive, settings: EvaluationSettings) -> Task:
    """All movements of the archive, cut out."""
    return AccuracyTask(title, protocol, archive, {f"all {len(settings.labels)}": settings}, {})


def _msr(parts: Parts, folder: Path) -> Task:
    archive = import_recordings("msr-action3d", folder).archive
    sets, protocol = sets_of(_settings(archive, False, parts)), "Learned from people 1, 3, 5, 7, 9."
    joint = PEERS if parts == BODY_PARTS else {}
    return AccuracyTask(f"MSR Action3D, {_named(parts)}, movements cut out", protocol, archive, sets, joint)


def _nw_ucla(parts: Parts, folder: Path) -> Task:
    texts = [f"sensor{n}={folder / f'sensor{n}.npz'}" for n in (1, 2, 3)]
    views, sensors = read_sensors(texts, read_archive)
    whole = performances(sensors)
    settings = replace(_settings(whole, True, parts), views=views, sensors=sensors)
    protocol = (
        "One person left out at a time; each sensor learns from its own recordings; a performance that a sensor lacks "
        "is judged by the others."
    )
    return _of_all(f"nw_ucla, {_named(parts)}, three sensors", protocol, whole, settings)


def _florence(parts: Parts, folder: Path) -> Task:
    archive = import_recordings("florence3d", folder).archive
    return _one_left_out("Florence 3D", archive, parts)


def _karate(parts: Parts, folder: Path) -> Task:
    more = "the spans of continuous recordings, without what is around them"
    return _one_left_out("karate", read_archive(folder / "karate.npz"), parts, more)


def _kinder_gator(parts: Parts, folder: Path) -> Task:
    more = "each movement once by each person, who chooses the side"
    return _one_left_out("Kinder-Gator, adults", read_archive(folder / "adults.npz"), parts, more)


def _ui_prmd(parts: Parts, folder: Path) -> Task:
    more = "repetitions done well and badly"
    return _one_left_out("UI-PRMD", read_archive(folder / "repetitions.npz"), parts, more)


def _one_left_out(name: str, archive: MotionArchive, parts: Parts, more: str = "") -> Task:
    protocol = "; ".join(filter(None, ("One person left out at a time", more))) + "."
    return _of_all(f"{name}, {_named(parts)}, movements cut out", protocol, archive, _settings(archive, True, parts))


SPOTTING = "One person left out at a time; spotting by the first word of a verdict."


def _karate_streams(folder: Path) -> Task:
    archive = read_archive(folder / "karate.npz")
    sets = {
        f"{', '.join(views)}: {_named(parts)}": _settings(archive, True, parts, views)
        for parts, views in ((BODY_PARTS, VIEWS), (WITH_FEET, VIEWS), (ALL_PARTS, VIEWS), (WITH_FEET, VIEWS[:1]))
    }
    return StreamTask("karate, continuous", SPOTTING, archive, sets)


def _ground_guide(folder: Path) -> Task:
    archive = read_archive(folder / "ground_guide.npz")
    sets = {"camera: shoulders, elbows, hands, hips": _settings(archive, True, ALL_PARTS, ("",))}
    return StreamTask("ground_guide, continuous, tracks in 2-D without a head", SPOTTING, archive, sets)


def _named(parts: Parts) -> str:
    return {BODY_PARTS: "hands and head", WITH_FEET: "hands, head and feet"}.get(parts, "whole body")


_CUT_OUT: Mapping[str, tuple[str, Callable[[Parts, Path], Task], Parts]] = {
    "msr": ("msr_action3d/MSRAction3DSkeletonReal3D", _msr, BODY_PARTS),
    "sensors": ("nw_ucla", _nw_ucla, BODY_PARTS),
    "florence": ("florence3d", _florence, BODY_PARTS),
    "karate": ("karate", _karate, WITH_FEET),
    "kinder": ("kinder_gator", _kinder_gator, BODY_PARTS),
    "prmd": ("ui_prmd", _ui_prmd, BODY_PARTS),
}
TASKS: Mapping[str, tuple[str, Callable[[Path], Task]]] = {
    **{name: (folder, partial(read, parts)) for name, (folder, read, parts) in _CUT_OUT.items()},
    **{f"{name}-all": (folder, partial(read, ALL_PARTS)) for name, (folder, read, _) in _CUT_OUT.items()},
    "streams": ("karate", _karate_streams),
    "guide": ("ground_guide", _ground_guide),
}
"""By name of the table the folder of LABANMESH_DATA and what reads it."""


def tasks_of(names: Sequence[str]) -> list[Task]:
    """The tasks of these tables, read from LABANMESH_DATA; raises BadInput for recordings that are not there."""
    data = os.environ.get("LABANMESH_DATA")
    for name in names:
        folder = TASKS[name][0]
        if not data or not (Path(data) / folder).is_dir():
            place = f"LABANMESH_DATA = {data!r} has no {folder}" if data else "LABANMESH_DATA is not set"
            raise BadInput(
                f"no archive is named and {place}; set it, or: python -m benchmarks.comparisons.classifiers ARCHIVE.npz"
            )
    return [TASKS[name][1](Path(data or "") / TASKS[name][0]) for name in names]
