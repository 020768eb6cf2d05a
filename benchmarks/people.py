"""Two people in one room: whose verdicts they get, and whether they are exchanged after they have crossed. SIMULATED.

    LABANMESH_DATA=... python -m benchmarks.people MSR.npz

Two recorded people are put into one room, some distance apart, each with movements of their own. They walk past each
other and go on at each other's place. Virtual cameras in the corners of the room see them; who is nearer covers the
other. The walk is simulated, the movements are recorded. Each is also judged alone in the room. A verdict of somebody
alone counts as kept if the same person has the same verdict at that time beside the other.
"""

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks.command_line import run_command
from common import SECOND_NS
from common.config_people import PeopleConfig
from common.config_sections import FusionConfig
from common.inbox import Arrival
from common.keys import SceneKeys
from common.messages import VerdictMessage
from common.posterior import PosteriorMessage
from common.vocabulary import Vocabulary
from common.wire import decode, encode
from fusion.engine.engine import FusionEngine
from fusion.people import ScenePeople, SeenTrack
from fusion.people_ingest import PeopleIngest
from observer.geometry.placement import PersonPlacement
from observer.geometry.projection import pinhole_matrix
from observer.geometry.views import View
from observer.learning.learn import learn_view
from observer.model.base import MovementModel
from observer.motion.archive import MotionArchive, Recording, Span
from observer.motion.archive_file import read_archive
from observer.motion.placing import placed
from observer.motion.projected_people import ProjectedPeople
from observer.runtime.people_observer import FloorPlacer, PeopleObserver
from observer.runtime.pipeline import Observer, PosteriorEncoder
from observer.runtime.prepared_tracker import PreparedTracker
from observer.runtime.resampler import Resampler
from observer.tracks import WHOLE_BODY, Floats, Frame, Tracker
from studies.performer.perform import minimum_jerk
from studies.trials import strung, with_labels

CORNERS_DEG = (45, -45, 135, -135)
"""Where the first, the second ... camera stands, seen from the middle of the room; 0 is before the people."""
DISTANCE_M, PITCH_DEG, FOCAL_PX, SIZE_PX = 3.5, 15.0, 520.0, (640, 480)
LABELS = ("high_arm_wave", "hand_clap", "two_hand_wave", "forward_kick", "side_kick", "golf_swing", "pickup_and_throw")
WALK_S, ASIDE_M = 2.5, 0.3
"""They cross in this time, each so far from the line between their places."""
BEGIN_NS = 1_700_000_000 * SECOND_NS
LATE_NS = 30_000_000
"""From a frame's capture until its posteriors are fused."""


@dataclass(frozen=True, slots=True, eq=False)
class RoomPart:
    """One person's part. positions: (F, P, 3), in the room. crossing: frames, begin and end. spans: as performed."""

    positions: Floats
    crossing: tuple[int, int]
    spans: Sequence[Span]


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """Two people `apart` m from each other, seen by the first cameras, which have learned from other people."""

    models: Sequence[MovementModel]
    people: tuple[RoomPart, RoomPart]
    rate_hz: float
    apart: float


@dataclass(slots=True)
class Run:
    """verdicts: ended. places: by person, (frame, x, z)."""

    verdicts: list[VerdictMessage] = field(default_factory=list)
    places: dict[str, list[tuple[int, float, float]]] = field(default_factory=dict)
    seconds: float = 0.0

    def id_at(self, frame: int, at: Floats) -> str | None:
        """Who was nearest to a place in that frame."""
        near = {
            person: float(np.hypot(x - at[0], z - at[2]))
            for person, places in self.places.items()
            for n, x, z in places
            if n == frame
        }
        return min(near, key=lambda person: near[person], default=None)


@dataclass(frozen=True, slots=True)
class Result:
    """alone: right verdicts of people alone. kept: of these, beside the other. wrong: verdicts beside the other that
    whoever has the id has not performed then. exchanged: whether both have another id after the crossing, lost: whether
    one has none.
    """

    alone: int
    kept: int
    wrong: int
    performed: int
    exchanged: bool
    lost: bool


def camera(number: int) -> View:
    """One of the virtual cameras."""
    yaw, pitch = np.radians(CORNERS_DEG[number]), np.radians(PITCH_DEG)
    middle = (SIZE_PX[0] / 2, SIZE_PX[1] / 2)
    matrix = pinhole_matrix(float(yaw), float(pitch), DISTANCE_M, FOCAL_PX, middle, (0.0, 0.9, 0.0))
    return View(f"corner{number}", matrix, None, SIZE_PX)


def performed(recordings: Sequence[Recording], parts: tuple[str, ...], places: tuple[Floats, Floats], aside: float,
              rng: np.random.Generator) -> RoomPart:  # fmt: skip
    """Half of the recordings at the first place, the others at the second, and the walk in between."""
    half = len(recordings) // 2
    halves, spans, frames = [], list[Span](), 0
    for which, at in zip((recordings[:half], recordings[half:]), places, strict=True):
        (stream,) = strung(which, rng)
        archive = MotionArchive(parts, (stream,))
        (stream,) = placed(archive, PersonPlacement(float(at[0]), float(at[1]))).recordings
        halves.append(stream.positions.astype(np.float64))
        spans += [Span(frames + s.start, frames + s.end, s.label) for s in stream.spans]
        frames += len(stream.positions) + (0 if spans[1:] and len(halves) > 1 else round(WALK_S * stream.rate_hz))
    first, second = halves
    share = minimum_jerk(np.linspace(0, 1, round(WALK_S * recordings[0].rate_hz)))[:, None, None]
    between = first[-1] * (1 - share) + second[0] * share
    between[:, :, 2] += aside * np.sin(np.pi * share[:, :, 0])
    walked = np.concatenate([first, between, second])
    return RoomPart(walked, (len(first), len(first) + len(between)), spans)


def together(one: RoomPart, other: RoomPart) -> tuple[RoomPart, RoomPart]:
    """The same, crossing at one time and equally long: who is ready earlier waits."""
    begin = max(one.crossing[0], other.crossing[0])
    padded = [_waiting(each, begin - each.crossing[0], each.crossing[0]) for each in (one, other)]
    length = max(len(each.positions) for each in padded)
    first, second = (_waiting(each, length - len(each.positions), len(each.positions)) for each in padded)
    return first, second


def _waiting(person: RoomPart, frames: int, before: int) -> RoomPart:
    still = np.repeat(person.positions[before - 1 : before], frames, axis=0)
    positions = np.concatenate([person.positions[:before], still, person.positions[before:]])
    begin, end = (at + frames if at >= before else at for at in person.crossing)
    moved = [Span(s.start + frames, s.end + frames, s.label) if s.start >= before else s for s in person.spans]
    return RoomPart(positions, (begin, end), moved)


class Stage:
    """The observers and the fusion of one room, in one process."""

    def __init__(self, models: Sequence[MovementModel], rate_hz: float) -> None:
        self._vocabulary, self._rate_hz = models[0].header.vocabulary, rate_hz
        parts = (*WHOLE_BODY, *(f"{part}@2" for part in WHOLE_BODY))
        names = [f"corner{number}" for number in range(len(models))]
        self._observers = []
        for number, model in enumerate(models):
            view = camera(number)
            tracker = PreparedTracker(ProjectedPeople(view, parts, 2), model.header.body_parts, view)
            self._observers.append(PeopleObserver(tracker, _maker(model), FloorPlacer(view, None, alone=False)))
        keys = SceneKeys("people")
        self._keys = [keys.posterior(name) for name in names]
        self._encoders = [PosteriorEncoder(self._vocabulary, f"s{number}") for number in range(len(models))]
        ids = PeopleConfig(most=2).ids
        config = FusionConfig(quorum=(len(names) + 1) // 2)
        self._engines = {p: FusionEngine("people", names, self._vocabulary, config, p) for p in ids}
        self._people = ScenePeople(ids)
        self._ingest = PeopleIngest(self._people, names, lambda _: None)

    def run(self, positions: Floats) -> Run:
        """Judge (F, 2 P, 3)."""
        run, begun_s = Run(), time.process_time()
        for n, content in enumerate(positions):
            at_ns = BEGIN_NS + round(n * SECOND_NS / self._rate_hz)
            now_ns = at_ns + LATE_NS
            arrivals = []
            for observer, encoder, key in zip(self._observers, self._encoders, self._keys, strict=True):
                posterior = observer.step(Frame(at_ns, content))
                messages = [encoder.encode(each, at_ns, at_ns) for each in (posterior, *posterior.others)]
                arrivals += [Arrival(key, encode(message), now_ns) for message in messages]
            for person, own in self._ingest.sort(arrivals, now_ns).items():
                for arrival in own:
                    name = arrival.key.rsplit("/", 2)[-2]
                    self._engines[person].receive(name, decode(PosteriorMessage, arrival.payload), now_ns)
            for person, engine in self._engines.items():
                output = engine.step(now_ns)
                run.verdicts += [verdict for verdict in output.verdicts if verdict.stage == "ended"]
                if (at := self._people.place(person, now_ns)) is not None:
                    run.places.setdefault(person, []).append((n, *at))
        run.seconds = time.process_time() - begun_s
        return run


def crossed(people: tuple[RoomPart, RoomPart], rate_hz: float, cameras: int) -> tuple[bool, bool]:
    """Whether two people who cross are exchanged, and whether one is lost, by their places alone."""
    parts = (*WHOLE_BODY, *(f"{part}@2" for part in WHOLE_BODY))
    views = [camera(number) for number in range(cameras)]
    trackers = [PreparedTracker(ProjectedPeople(view, parts, 2), WHOLE_BODY, view) for view in views]
    placers = [FloorPlacer(view, None, alone=False) for view in views]
    room, run = ScenePeople(PeopleConfig(most=2).ids), Run()
    begin, end = people[0].crossing
    first, last = max(begin - round(2 * rate_hz), 0), min(end + round(3 * rate_hz), len(people[0].positions)) - 1
    for n in range(first, last + 1):
        at_ns = BEGIN_NS + round(n * SECOND_NS / rate_hz)
        content = np.concatenate([person.positions[n] for person in people])
        sightings = []
        for number, (tracker, placer) in enumerate(zip(trackers, placers, strict=True)):
            tracker.update(Frame(at_ns, content))
            places = [(str(track.id), placer.place(WHOLE_BODY, track, 0)) for track in tracker.persons()]
            sightings += [SeenTrack(f"corner{number}", track, place, at_ns) for track, place in places if place]
        room.update(sightings, at_ns)
        for person in room.present:
            run.places.setdefault(person, []).append((n, *(room.place(person, at_ns) or (0.0, 0.0))))
    ids = [[run.id_at(n, _middle(person, n)) for n in (begin - 1, last)] for person in people]
    lost = any(None in pair for pair in ids) or ids[0][0] == ids[1][0]
    return any(early != late for early, late in ids) and not lost, lost


def _middle(person: RoomPart, frame: int) -> Floats:
    """(3,) the mean of the body, where it was recorded last up to that frame: recordings have gaps."""
    for body in person.positions[frame::-1]:
        seen = body[np.isfinite(body).all(axis=1)]
        if len(seen):
            middle: Floats = seen.mean(axis=0)
            return middle
    return np.full(3, np.nan)


def _maker(model: MovementModel) -> Callable[[Tracker], Observer]:
    def new(tracker: Tracker) -> Observer:
        return Observer(tracker, model, None, Resampler(model.header.rate_hz))

    return new


def judged(trial: Trial) -> Result:
    """One trial: each alone, then both."""
    one, other = (person.positions for person in trial.people)
    nobody = np.full_like(one, np.nan)
    both = Stage(trial.models, trial.rate_hz).run(np.concatenate([one, other], axis=1))
    alone = kept = wrong = total = 0
    exchanged = lost = False
    for number, person in enumerate(trial.people):
        content = [one, nobody] if number == 0 else [nobody, other]
        own = Stage(trial.models, trial.rate_hz).run(np.concatenate(content, axis=1))
        begin, _ = person.crossing
        early = both.id_at(begin - 1, _middle(person, begin - 1))
        late = both.id_at(len(person.positions) - 1, _middle(person, len(person.positions) - 1))
        exchanged |= early != late and None not in (early, late)
        lost |= early is None or late is None
        theirs = [verdict for verdict in both.verdicts if verdict.person == early]
        right = [verdict for verdict in own.verdicts if _is_right(verdict, person, trial.rate_hz)]
        alone += len(right)
        kept += sum(any(_is_same(verdict, each) for each in theirs) for verdict in right)
        wrong += sum(verdict.label != "abstain" and not _is_right(verdict, person, trial.rate_hz) for verdict in theirs)
        total += len(person.spans)
    return Result(alone, kept, wrong, total, exchanged, lost)


def _is_right(verdict: VerdictMessage, person: RoomPart, rate_hz: float) -> bool:
    begin, end = ((at - BEGIN_NS) / SECOND_NS * rate_hz for at in (verdict.began_ns, verdict.ended_ns or 0))
    return any(s.label == verdict.label and begin < s.end and end > s.start for s in person.spans)


def _is_same(one: VerdictMessage, other: VerdictMessage) -> bool:
    ends = one.ended_ns or 0, other.ended_ns or 0
    return one.label == other.label and one.began_ns < ends[1] and other.began_ns < ends[0]


def main(
    archive: Annotated[Path, typer.Argument(help="MSR Action3D as a motion archive.")],
    learn: Annotated[str, typer.Option(help="Whose recordings the observers learn from.")] = "1,3,5",
    show: Annotated[str, typer.Option(help="Who performs.")] = "7,9",
    apart: Annotated[str, typer.Option(help="Metres between the two.")] = "1,1.5,2",
    cameras: Annotated[str, typer.Option(help="How many cameras.")] = "2,3,4",
    takes: Annotated[int, typer.Option(help="Recordings of each movement and person that are performed.")] = 2,
    crossings: Annotated[int, typer.Option(help="So many crossings by places alone, without movements.")] = 0,
    seed: int = 0,
) -> None:
    """Print a row for each distance and number of cameras."""
    data = with_labels(read_archive(archive), LABELS)
    rows = [data.body_parts.index(part) for part in WHOLE_BODY]
    data = MotionArchive(WHOLE_BODY, tuple(_of_rows(r, rows) for r in data.recordings))
    learned = MotionArchive(WHOLE_BODY, tuple(r for r in data.recordings if r.subject in learn.split(",")))
    numbers = [int(each) for each in cameras.split(",")]
    if crossings:
        _print_crossings(data, [float(each) for each in apart.split(",")], numbers, show.split(","), crossings, seed)
        return
    vocabulary, place = Vocabulary(LABELS), PersonPlacement()
    models = [learn_view(learned, camera(n), vocabulary, placement=place) for n in range(max(numbers))]
    print("apart_m cameras performed alone kept share wrong exchanged lost", flush=True)
    people = show.split(",")
    pairs = list(pairwise([*people, people[0]])) if len(people) > 2 else [(people[0], people[1])]
    for metres in map(float, apart.split(",")):
        for number in numbers:
            trials = [_trial(data, models[:number], pair, metres, takes, seed + n) for n, pair in enumerate(pairs)]
            results = [judged(trial) for trial in trials]
            alone, kept, wrong, total, exchanged, lost = (
                sum(getattr(result, name) for result in results)
                for name in ("alone", "kept", "wrong", "performed", "exchanged", "lost")
            )
            print(f"{metres:7g} {number:7d} {total:9d} {alone:5d} {kept:4d} {kept / max(alone, 1):5.3f} {wrong:5d} "
                  f"{exchanged:5d}/{len(trials)} {lost}", flush=True)  # fmt: skip


def _print_crossings(
    data: MotionArchive, apart: Sequence[float], cameras: Sequence[int], people: Sequence[str], count: int, seed: int
) -> None:
    print("apart_m cameras crossings exchanged lost", flush=True)
    for metres in apart:
        trials = [
            _trial(data, [], (people[n % len(people)], people[(n + 1) % len(people)]), metres, 1, seed + n)
            for n in range(count)
        ]
        for number in cameras:
            results = [crossed(trial.people, trial.rate_hz, number) for trial in trials]
            exchanged, lost = (sum(each) for each in zip(*results, strict=True))
            print(f"{metres:7g} {number:7d} {count:9d} {exchanged:9d} {lost:4d}", flush=True)


def _of_rows(recording: Recording, rows: Sequence[int]) -> Recording:
    return Recording(recording.positions[:, rows], recording.rate_hz, recording.label, recording.subject,
                     recording.trial, recording.spans)  # fmt: skip


def _trial(
    data: MotionArchive, models: Sequence[MovementModel], pair: tuple[str, str], apart: float, takes: int, seed: int
) -> Trial:
    rng = np.random.default_rng(seed)
    aside = ASIDE_M * rng.choice([-1, 1])
    places = np.array([apart / 2, 0.0]), np.array([-apart / 2, 0.0])
    parts = []
    for number, subject in enumerate(pair):
        own = [r for r in data.recordings if r.subject == subject]
        chosen = [r for label in LABELS for r in [r for r in own if r.label == label][:takes]]
        chosen = [chosen[i] for i in rng.permutation(len(chosen))]
        there = places if number == 0 else places[::-1]
        parts.append(performed(chosen, WHOLE_BODY, (there[0], there[1]), aside * (1 - 2 * number), rng))
    return Trial(models, together(*parts), data.recordings[0].rate_hz, apart)


if __name__ == "__main__":
    sys.exit(run_command(main, "people"))
