"""The watch for falls: falls that it sees, and false alarms.

    LABANMESH_DATA=... python -m benchmarks.falls

1. The windows of `falls`: 2-D tracks of one camera, a fall or something else. A window ends before N seconds are over,
   so what follows is that nobody is seen, after windows of both kinds.
2. Falls of the synthetic performer, SIMULATED: eight directions, fast and slow, four people, four views of level
   cameras and of cameras that look down by 20 degrees. Seen in time is an alarm between the first lean and 2 s after
   the body lies. Then what comes near to a fall: tying shoes, squatting, sitting down on the floor, picking up.
3. Recordings of people who do not fall, by each view alone and by all together; each is followed by nobody.

Nothing is learned; the numbers of the watch are those of observer/preview/posture_outlet.py and fusion/engine/falls.py.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated

import typer

from benchmarks.command_line import run_command
from benchmarks.simulated_falls import DIRECTIONS_DEG, EVERYDAY, everyday, fall
from common import SECOND_NS
from common.config_people import FallenConfig
from common.errors import BadInput
from common.fall_messages import FallStage
from fusion.engine.falls import FallDetector
from observer.geometry.projection import project
from observer.geometry.views import parse_view
from observer.motion.archive import MotionArchive, Recording
from observer.motion.archive_file import read_archive
from observer.preview.posture_outlet import LyingBorders, LyingReader
from observer.tracks import WHOLE_BODY, Floats
from studies.performer.perform import PEOPLE

LEVEL = ("door", "wheel", "yaw:180", "yaw:270")
RAISED = tuple(f"yaw:{yaw},pitch:20" for yaw in (0, 90, 180, 270))
IN_TIME_S, AFTER_S = 2.0, 3.0
"""An alarm is in time so long after the body lies; nobody is seen for so long after each recording."""
BEGIN_NS = SECOND_NS
PEOPLE_WHO_DO_NOT_FALL = {
    "karate": ("karate/karate.npz",),
    "storytelling": ("storytelling/storytelling.npz",),
    "nw_ucla": tuple(f"nw_ucla/sensor{number}.npz" for number in (1, 2, 3)),
    "ui_prmd": ("ui_prmd/sets.npz",),
    "kinder_gator": ("kinder_gator/adults.npz",),
}


@dataclass(frozen=True, slots=True)
class WatchedRun:
    """When each stage began, s from the first frame."""

    stages: Sequence[tuple[float, FallStage]]

    def alarm_s(self) -> float | None:
        """When the first alarm came; None: there was none."""
        return next((at_s for at_s, stage in self.stages if stage == "fallen"), None)


def watch(
    tracks: Sequence[Floats], body_parts: Sequence[str], rate_hz: float, borders: LyingBorders | None = None
) -> WatchedRun:
    """Let one observer watch each of the (F, P, 2) tracks, and one detector all of them."""
    readers = [LyingReader(body_parts, borders) for _ in tracks]
    detector, stages = FallDetector(FallenConfig().after_s), list[tuple[float, FallStage]]()
    frames = len(tracks[0])
    for frame in range(frames + round(AFTER_S * rate_hz)):
        at_ns = BEGIN_NS + round(frame / rate_hz * SECOND_NS)
        lying = {
            str(n): reader.update(centres[frame], at_ns) if frame < frames else None
            for n, (reader, centres) in enumerate(zip(readers, tracks, strict=True))
        }
        stage = detector.update(lying, at_ns).stage
        if not stages or stage != stages[-1][1]:
            stages.append((frame / rate_hz, stage))
    return WatchedRun(stages)


def seen_from(recording: Recording, views: Sequence[str]) -> list[Floats]:
    """The tracks of a recording in each view."""
    return [project(parse_view(view).matrix, recording.positions) for view in views]


def windows(archive: MotionArchive) -> Iterator[str]:
    """The rows of 2-D windows that are falls or something else."""
    for label in ("fall", "other"):
        runs = [
            watch([each.positions.astype(float)], archive.body_parts, each.rate_hz)
            for each in archive.recordings
            if each.label == label
        ]
        alarms = sum(run.alarm_s() is not None for run in runs)
        yield f"windows of {label:<6}  alarms {alarms} of {len(runs)}"


def simulated() -> Iterator[str]:
    """The rows of simulated falls, and of what comes near to one."""
    for name, views in (("level", LEVEL), ("20 degrees down", RAISED)):
        for slow in (False, True):
            cases = list(product(PEOPLE, DIRECTIONS_DEG))
            in_time = [0] * (len(views) + 1)
            late_s = []
            for seed, (person, direction) in enumerate(cases):
                fallen = fall(person, direction, slow, seed=seed)
                tracks = seen_from(fallen.recording, views)
                for n, seen in enumerate([*([each] for each in tracks), tracks]):
                    alarm_s = watch(seen, WHOLE_BODY, fallen.recording.rate_hz).alarm_s()
                    good = alarm_s is not None and fallen.begins_s <= alarm_s <= fallen.lies_s + IN_TIME_S
                    in_time[n] += good
                    if good and alarm_s is not None and n == len(views):
                        late_s.append(alarm_s - fallen.lies_s)
            alone = ", ".join(map(str, in_time[:-1]))
            slowest = f"last {max(late_s):.1f} s after lying" if late_s else ""
            yield (
                f"SIMULATED falls, {'slow' if slow else 'fast'}, cameras {name}: "
                f"all four {in_time[-1]} of {len(cases)}, {slowest}; each alone {alone}"
            )
        for what in EVERYDAY:
            recordings = [everyday(person, what, seed=seed) for seed, person in enumerate(PEOPLE)]
            alarms = [
                watch(seen, WHOLE_BODY, each.rate_hz).alarm_s() is not None
                for each in recordings
                for seen in (lambda tracks: [*([one] for one in tracks), tracks])(seen_from(each, views))
            ]
            yield f"SIMULATED {what}, cameras {name}: false alarms {sum(alarms)} of {len(alarms)}"


def false_alarms(name: str, archives: Sequence[MotionArchive]) -> str:
    """The row of recordings of people who do not fall. Sensors of nw_ucla are not in step: each is watched alone."""
    views = ("door",) if len(archives) > 1 else (*LEVEL[:2], "yaw:45", "yaw:180")
    recordings = [(archive, each) for archive in archives for each in archive.recordings]
    hours = sum(len(each.positions) / each.rate_hz for _, each in recordings) / 3600
    if not LyingReader(archives[0].body_parts).can_tell:
        return f"{name:<13} {hours:.2f} h  no legs in it: no observer can tell, so there is no alarm"
    alone = together = 0
    for archive, each in recordings:
        tracks = seen_from(each, views)
        alarms = [watch([one], archive.body_parts, each.rate_hz).alarm_s() for one in tracks]
        alone += sum(alarm is not None for alarm in alarms)
        if len(views) > 1:
            together += watch(tracks, archive.body_parts, each.rate_hz).alarm_s() is not None
    joined = f", all together {together}" if len(views) > 1 else ""
    return f"{name:<13} {hours:.2f} h  false alarms: {len(views)} views alone {alone}{joined}"


def cost() -> str:
    """Microseconds of an observer's step and of a decision on four observers."""
    fallen = fall(PEOPLE[0], 0, slow=False)
    tracks = seen_from(fallen.recording, ("door",))[0]
    reader, detector = LyingReader(WHOLE_BODY), FallDetector(FallenConfig().after_s)
    begun_s = time.process_time()
    for frame, centres in enumerate(tracks):
        reader.update(centres, BEGIN_NS + frame * SECOND_NS // 30)
    read_s = time.process_time() - begun_s
    lying = {"a": 0.1, "b": 0.2, "c": None, "d": 0.3}
    begun_s = time.process_time()
    for frame in range(len(tracks)):
        detector.update(lying, BEGIN_NS + frame * SECOND_NS // 30)
    decided_s = time.process_time() - begun_s
    return f"cost: {1e6 * read_s / len(tracks):.0f} us a frame, {1e6 * decided_s / len(tracks):.0f} us a decision"


def falls(
    data: Annotated[Path | None, typer.Option(envvar="LABANMESH_DATA", help="The folder of recordings.")] = None,
) -> None:
    """Measure the watch for falls: falls seen, false alarms, cost.

    Example: LABANMESH_DATA=data python -m benchmarks.falls
    """
    if data is None:
        raise BadInput("name the folder of recordings: LABANMESH_DATA=FOLDER, or --data FOLDER")
    for line in (*windows(read_archive(data / "falls/falls.npz")), *simulated()):
        print(line, flush=True)
    for name, files in PEOPLE_WHO_DO_NOT_FALL.items():
        print(false_alarms(name, [read_archive(data / file) for file in files]), flush=True)
    print(cost())


if __name__ == "__main__":
    raise SystemExit(run_command(falls, "falls"))
