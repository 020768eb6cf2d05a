"""Five takes by one person, the next one judged: three movements drawn at random, the others are not learned.

Recorded people in 3-D, seen by two cameras as each would see them; what is learned and judged are 2-D tracks. The take
that is judged was never learned. Where a person has fewer than six takes of a movement, all but one are learned.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.taught.judging import TaughtModels, names_in, verdicts_on
from common.parallel import cores, run_parts
from observer.geometry.projection import pinhole_matrix
from observer.geometry.views import View
from observer.motion.archive import MotionArchive, Recording, TracksCamera, labels_of, resample, select
from observer.motion.archive_file import read_archive
from observer.motion.importers.florence3d import import_folder as import_florence3d
from observer.motion.importers.msr_action3d import import_folder
from observer.motion.projected import projected
from observer.tracks import BODY_PARTS
from studies.sensors import same_streams, with_parts
from studies.trials import strung

Progress = Callable[[int, int], None]
MOVEMENTS, MOST_TAKES, MOST_OF_FLORENCE = 3, 5, 3
FOCAL_PX, CENTRE_PX, DISTANCE_M = 580.0, (320.0, 240.0), 3.0
SENSOR = np.array([[-FOCAL_PX, 0.0, 320.0, 0.0], [0.0, -FOCAL_PX, 240.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
"""(3, 4) a depth camera as it sees positions in its own axes, not mirrored."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedRoom:
    """Two cameras and what they recorded in 3-D, each in its own axes. least: takes that a movement needs.

    All cameras recorded the same body parts.
    """

    name: str
    space: Mapping[str, MotionArchive]
    views: Mapping[str, View]
    least: int

    @property
    def body_parts(self) -> tuple[str, ...]:
        """Names of the body parts that the cameras see."""
        return next(iter(self.space.values())).body_parts

    def seen(self, recordings: Mapping[str, Sequence[Recording]]) -> dict[str, MotionArchive]:
        """The tracks of each camera."""
        return {
            name: projected(MotionArchive(self.body_parts, tuple(shown)), self.views[name], TracksCamera(name))
            for name, shown in recordings.items()
        }


@dataclass(frozen=True, slots=True)
class Draw:
    """One person with three movements, and the seed of the rest around takes."""

    subject: str
    labels: tuple[str, ...]
    seed: int


@dataclass(frozen=True, slots=True)
class DrawResult:
    """takes: judged; right: whose first verdict is right; named: that got a verdict. false: verdicts in `minutes` of
    other movements."""

    draw: Draw
    learned: int
    takes: int
    right: int
    named: int
    false: int
    minutes: float


def msr_room(data: Path, whole_body: bool = False) -> RecordedRoom:
    """MSR Action3D, at most three takes, seen from 20 degrees left and 50 degrees right of the person."""
    return _gestures("MSR Action3D", _of(import_folder(data / "msr_action3d").archive, whole_body), 3)


def florence3d_room(data: Path, whole_body: bool = False) -> RecordedRoom:
    """Florence 3D Actions, two or three takes, seen as those of MSR Action3D. The last one is numbered 3."""
    archive = _of(import_florence3d(data / "florence3d").archive, whole_body)
    counts = Counter((r.subject, r.label) for r in archive.recordings)
    numbered = (
        replace(r, trial="3" if int(r.trial) == counts[r.subject, r.label] == 2 else r.trial)
        for r in archive.recordings
        if int(r.trial) <= MOST_OF_FLORENCE
    )
    return _gestures("Florence 3D Actions", replace(archive, recordings=tuple(numbered)), 2)


def _gestures(name: str, archive: MotionArchive, least: int) -> RecordedRoom:
    head = archive.body_parts.index("head")
    middle = np.nanmean(np.concatenate([r.positions[:, head] for r in archive.recordings]), axis=0)
    at, yaws = tuple(middle.tolist()), {"sofa": -20.0, "shelf": 50.0}
    views = {
        camera: View(camera, pinhole_matrix(np.deg2rad(yaw), 0.1, DISTANCE_M, FOCAL_PX, CENTRE_PX, at))
        for camera, yaw in yaws.items()
    }
    return RecordedRoom(name, dict.fromkeys(views, archive), views, least)


def nw_ucla_room(data: Path, whole_body: bool = False) -> RecordedRoom:
    """Northwestern-UCLA: five or six takes, two real depth cameras at once, each sees what it recorded."""
    files = {"left": "sensor1.npz", "right": "sensor2.npz"}
    space = {name: _of(read_archive(data / "nw_ucla" / file), whole_body) for name, file in files.items()}
    return RecordedRoom("nw_ucla", space, {name: View(name, SENSOR) for name in files}, 5)


def _of(archive: MotionArchive, whole_body: bool) -> MotionArchive:
    return archive if whole_body else with_parts(archive, BODY_PARTS)


def life_in(room: RecordedRoom, data: Path) -> dict[str, MotionArchive]:
    """Other people's storytelling as the cameras of the room would see it: what else a person does there."""
    stories = spread(read_archive(data / "storytelling" / "storytelling.npz"), room.body_parts)
    return room.seen(dict.fromkeys(room.views, moved_into(room, stories)))


def spread(archive: MotionArchive, parts: tuple[str, ...]) -> MotionArchive:
    """The recordings with these body parts, in this order; one that was not recorded is missing."""
    recordings = []
    for recording in archive.recordings:
        frames, _, axes = recording.positions.shape
        positions = np.full((frames, len(parts), axes), np.nan, np.float32)
        for row, part in enumerate(parts):
            if part in archive.body_parts:
                positions[:, row] = recording.positions[:, archive.body_parts.index(part)]
        recordings.append(replace(recording, positions=positions))
    return MotionArchive(parts, tuple(recordings))


def moved_into(room: RecordedRoom, life: MotionArchive) -> tuple[Recording, ...]:
    """Recordings of ordinary life at the place and rate of the room's, without labels."""
    first = next(iter(room.space.values()))
    rate_hz = first.recordings[0].rate_hz
    head = room.body_parts.index("head")
    heads = [np.nanmedian(np.concatenate([r.positions[:, head] for r in a.recordings]), axis=0) for a in (first, life)]
    return tuple(
        replace(r, positions=(r.positions + (heads[0] - heads[1])).astype(np.float32), label="", spans=())
        for r in (resample(r, rate_hz) for r in life.recordings)
    )


def draws(room: RecordedRoom, count: int, seed: int) -> list[Draw]:
    """`count` people with three movements each, of which the person has enough takes."""
    rng = np.random.default_rng(seed)
    first = next(iter(room.space.values()))
    counts = Counter((r.subject, r.label) for r in first.recordings)
    people = sorted({s for s, _ in counts})
    result: list[Draw] = []
    while len(result) < count:
        subject = people[int(rng.integers(len(people)))]
        enough = [label for label in labels_of(first) if counts[subject, label] >= room.least]
        if len(enough) >= MOVEMENTS:
            chosen = rng.permutation(len(enough))[:MOVEMENTS]
            result.append(Draw(subject, tuple(enough[n] for n in sorted(chosen.tolist())), len(result)))
    return result


def judge_draw(draw: Draw, room: RecordedRoom, teaching: TaughtModels) -> DrawResult:
    """Each take of the three movements, judged by models of the others; then all other movements of the person."""
    own = {name: select(archive, [draw.subject]).recordings for name, archive in room.space.items()}
    takes = {name: [r for r in rs if r.label in draw.labels] for name, rs in own.items()}
    first = next(iter(takes.values()))
    learned, judged, right, named = 0, 0, 0, 0
    models = None
    for n in range(max(Counter(r.label for r in first).values())):
        out = [take for label in draw.labels for take in [r for r in first if r.label == label][n : n + 1]]
        keys = {(take.label, take.trial) for take in out}
        shown = {name: few([r for r in rs if (r.label, r.trial) not in keys]) for name, rs in takes.items()}
        models = teaching.models(room.seen(shown), draw.labels)
        learned = max(learned, *Counter(r.label for r in shown[next(iter(shown))]).values())
        for take in out:
            names = names_in(verdicts_on(streams_of(room, [take], draw.seed), room.body_parts, models))
            judged, right, named = judged + 1, right + (names[:1] == [take.label]), named + bool(names)
    others = [r for r in next(iter(own.values())) if r.label not in draw.labels]
    false, frames = 0, 0
    if models is not None and others:
        streams = streams_of(room, others, draw.seed)
        false, frames = (
            len(names_in(verdicts_on(streams, room.body_parts, models))),
            len(next(iter(streams.values())).positions),
        )
    return DrawResult(draw, learned, judged, right, named, false, frames / first[0].rate_hz / 60)


def few(takes: Sequence[Recording]) -> list[Recording]:
    """The first MOST_TAKES of each movement."""
    counts: Counter[str] = Counter()
    result = []
    for take in takes:
        counts[take.label] += 1
        if counts[take.label] <= MOST_TAKES:
            result.append(take)
    return result


def streams_of(room: RecordedRoom, takes: Sequence[Recording], seed: int) -> dict[str, Recording]:
    """The takes with rest between, as each camera sees them; what a camera did not record it does not see."""
    result = {}
    for name, archive in room.space.items():
        own = same_streams(archive, takes)
        (whole,) = strung(own, np.random.default_rng(seed))
        streams = room.seen({name: [whole]})[name].recordings
        if streams:
            result[name] = streams[0]
    return result


def rows(
    room: RecordedRoom, teaching: TaughtModels, count: int, seed: int, jobs: int, progress: Progress
) -> Iterator[str]:
    """A line for each draw, and one for all."""
    parts = draws(room, count, seed)
    results = run_parts(partial(judge_draw, room=room, teaching=teaching), parts, jobs or cores(), progress)
    for one in results:
        yield f"  {one.draw.subject}: {', '.join(one.draw.labels)}: {_figures([one])}"
    yield f"{room.name}: {_figures(results)}"


def _figures(results: Sequence[DrawResult]) -> str:
    takes, right, named = (sum(getattr(one, name) for one in results) for name in ("takes", "right", "named"))
    minutes = sum(one.minutes for one in results)
    false = sum(one.false for one in results) / max(minutes, 1e-9)
    learned = max(one.learned for one in results)
    return (
        f"{right} of {takes} right ({right / takes:.3f}), {named - right} named wrongly, {takes - named} not named; "
        f"{false:.2f} false a minute of other movements ({minutes:.1f} minutes); up to {learned} takes learned"
    )
