"""Two people in one room: whose verdicts they get, and whether they are exchanged after they have crossed. SIMULATED.

    python -m benchmarks.people MSR.npz
    python -m benchmarks.people MSR.npz --crossings 50
    python -m benchmarks.people MSR.npz --cost --cameras 4

Two recorded people are put into one room, some distance apart, each with movements of their own. They walk past each
other and go on at each other's place. Virtual cameras in the corners of the room see them; who is nearer covers the
other. The walk is simulated, the movements are recorded. Each is also judged alone in the room. A verdict of somebody
alone counts as kept if the same person has the same verdict at that time beside the other.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks.command_line import run_command
from benchmarks.people_room import ASIDE_M, BEGIN_NS, RoomPart, Run, Stage, camera, middle_of, performed, together
from common import SECOND_NS
from common.config_people import PeopleConfig
from common.messages import VerdictMessage
from common.vocabulary import Vocabulary
from fusion.people import ScenePeople, SeenTrack
from observer.geometry.placement import PersonPlacement
from observer.learning.learn import learn_view
from observer.model.base import MovementModel
from observer.motion.archive import MotionArchive, Recording, labels_of, movements_in
from observer.motion.archive_file import read_archive
from observer.motion.projected import ProjectedPeople, placed
from observer.prepared_tracks import PreparedTracker
from observer.runtime.people_observer import FloorPlacer
from observer.tracking.person_keeper import of_people
from observer.tracks import WHOLE_BODY, Frame
from studies.trials import strung, with_labels

LABELS = ("high_arm_wave", "hand_clap", "two_hand_wave", "forward_kick", "side_kick", "golf_swing", "pickup_and_throw")


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """Two people `apart` m from each other, seen by the first cameras, which have learned from other people."""

    models: Sequence[MovementModel]
    people: tuple[RoomPart, RoomPart]
    rate_hz: float
    apart: float


@dataclass(frozen=True, slots=True)
class Result:
    """alone: right verdicts of people alone. kept: of these, beside the other. wrong_alone, wrong: verdicts alone, and
    beside the other, that whoever has the id has not performed then. exchanged: whether one mostly has another id after
    the crossing, lost: whether one has none.
    """

    alone: int
    kept: int
    wrong_alone: int
    wrong: int
    performed: int
    exchanged: bool
    lost: bool


def crossed(people: tuple[RoomPart, RoomPart], rate_hz: float, cameras: int) -> tuple[bool, bool]:
    """Whether two people who cross are exchanged, and whether one is lost, by their places alone."""
    parts = of_people(WHOLE_BODY, 2)
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
    ids = [[run.id_at(n, middle_of(person, n)) for n in (begin - 1, last)] for person in people]
    lost = any(None in pair for pair in ids) or ids[0][0] == ids[1][0]
    return any(early != late for early, late in ids) and not lost, lost


def judged(trial: Trial) -> Result:
    """One trial: each alone, then both."""
    one, other = (person.positions for person in trial.people)
    nobody = np.full_like(one, np.nan)
    both = Stage(trial.models, trial.rate_hz).run(np.concatenate([one, other], axis=1))
    alone = kept = wrong_alone = wrong = total = 0
    exchanged = lost = False
    for number, person in enumerate(trial.people):
        content = [one, nobody] if number == 0 else [nobody, other]
        own = Stage(trial.models, trial.rate_hz).run(np.concatenate(content, axis=1))
        begin, end = person.crossing
        early, late = (both.id_of(person, *frames) for frames in ((0, begin), (end, len(person.positions))))
        exchanged |= early != late and None not in (early, late)
        lost |= early is None or late is None
        theirs = [verdict for verdict in both.verdicts if verdict.person == early]
        right = [verdict for verdict in own.verdicts if is_right(verdict, person, trial.rate_hz)]
        alone += len(right)
        kept += sum(any(is_same(verdict, each) for each in theirs) for verdict in right)
        wrong_alone += sum(verdict.label != "abstain" for verdict in own.verdicts) - len(right)
        wrong += sum(verdict.label != "abstain" and not is_right(verdict, person, trial.rate_hz) for verdict in theirs)
        total += len(person.spans)
    return Result(alone, kept, wrong_alone, wrong, total, exchanged, lost)


def is_right(verdict: VerdictMessage, person: RoomPart, rate_hz: float, begin_ns: int = BEGIN_NS) -> bool:
    """Whether the person has performed that then; begin_ns: when the first frame was."""
    begin, end = ((at - begin_ns) / SECOND_NS * rate_hz for at in (verdict.began_ns, verdict.ended_ns or 0))
    return any(s.label == verdict.label and begin < s.end and end > s.start for s in person.spans)


def is_same(one: VerdictMessage, other: VerdictMessage) -> bool:
    """Whether both name the same movement at a common time."""
    ends = one.ended_ns or 0, other.ended_ns or 0
    return one.label == other.label and one.began_ns < ends[1] and other.began_ns < ends[0]


def main(
    archive: Annotated[Path, typer.Argument(help="A motion archive of the whole body.")],
    labels: Annotated[str, typer.Option(help="Movements of the vocabulary.")] = ",".join(LABELS),
    learn: Annotated[str, typer.Option(help="Whose recordings the observers learn from.")] = "1,3,5",
    show: Annotated[str, typer.Option(help="Who performs.")] = "7,9",
    apart: Annotated[str, typer.Option(help="Metres between the two.")] = "1,1.5,2",
    cameras: Annotated[str, typer.Option(help="How many cameras.")] = "2,3,4",
    takes: Annotated[int, typer.Option(help="Recordings of each movement and person that are performed.")] = 2,
    cost: Annotated[bool, typer.Option(help="Processor time with one, two and four people, without walks.")] = False,
    crossings: Annotated[int, typer.Option(help="So many crossings by places alone, without movements.")] = 0,
    seed: int = 0,
) -> None:
    """Print a row for each distance and number of cameras."""
    data = chosen(archive, labels)
    learned = learned_from(data, learn)
    numbers = [int(each) for each in cameras.split(",")]
    if crossings:
        _print_crossings(data, [float(each) for each in apart.split(",")], numbers, show.split(","), crossings, seed)
        return
    models = models_of(learned, max(numbers))
    if cost:
        _print_cost(data, models, show.split(",")[0], seed)
        return
    print("apart_m cameras performed alone kept share wrong_alone wrong exchanged lost", flush=True)
    for metres in map(float, apart.split(",")):
        for number in numbers:
            trials = [
                trial_of(data, models[:number], pair, metres, takes, seed + n) for n, pair in enumerate(pairs_of(show))
            ]
            results = [judged(trial) for trial in trials]
            alone, kept, wrong_alone, wrong, total, exchanged, lost = (
                sum(getattr(result, name) for result in results)
                for name in ("alone", "kept", "wrong_alone", "wrong", "performed", "exchanged", "lost")
            )
            print(f"{metres:7g} {number:7d} {total:9d} {alone:5d} {kept:4d} {kept / max(alone, 1):5.3f} "
                  f"{wrong_alone:5d} {wrong:5d} {exchanged:5d}/{len(trials)} {lost}", flush=True)  # fmt: skip


def _print_cost(data: MotionArchive, models: Sequence[MovementModel], subject: str, seed: int) -> None:
    """The same person once, twice and four times in one room, side by side."""
    own = [r for r in data.recordings if r.subject == subject]
    (stream,) = strung(
        [next(r for r in own if r.label == label) for label in labels_of(data)], np.random.default_rng(seed)
    )
    archive, first = MotionArchive(WHOLE_BODY, (stream,)), None
    print("people observer_ms fusion_ms observer fusion (a frame of all cameras; times that of one person)", flush=True)
    for count in (1, 2, 4):
        bodies = [placed(archive, PersonPlacement(0.9 * n - 1.3, 0.0)).recordings[0].positions for n in range(count)]
        run = Stage(models, stream.rate_hz, count).run(np.concatenate(bodies, axis=1).astype(np.float64))
        ms = 1000 * run.observers_s / len(bodies[0]), 1000 * run.fusion_s / len(bodies[0])
        first = first or ms
        print(f"{count:6d} {ms[0]:11.2f} {ms[1]:9.2f} {ms[0] / first[0]:8.2f} {ms[1] / first[1]:6.2f}", flush=True)


def _print_crossings(
    data: MotionArchive, apart: Sequence[float], cameras: Sequence[int], people: Sequence[str], count: int, seed: int
) -> None:
    print("apart_m cameras crossings exchanged lost", flush=True)
    for metres in apart:
        trials = [
            trial_of(data, [], (people[n % len(people)], people[(n + 1) % len(people)]), metres, 1, seed + n)
            for n in range(count)
        ]
        for number in cameras:
            results = [crossed(trial.people, trial.rate_hz, number) for trial in trials]
            exchanged, lost = (sum(each) for each in zip(*results, strict=True))
            print(f"{metres:7g} {number:7d} {count:9d} {exchanged:9d} {lost:4d}", flush=True)


def chosen(archive: Path, labels: str) -> MotionArchive:
    """The movements with these labels, of the whole body."""
    data = read_archive(archive)
    data = with_labels(MotionArchive(data.body_parts, tuple(movements_in(data))), labels.split(","))
    rows = [data.body_parts.index(part) for part in WHOLE_BODY]
    return MotionArchive(WHOLE_BODY, tuple(_of_rows(r, rows) for r in data.recordings))


def learned_from(data: MotionArchive, people: str) -> MotionArchive:
    """The recordings of these people."""
    return MotionArchive(data.body_parts, tuple(r for r in data.recordings if r.subject in people.split(",")))


def models_of(learned: MotionArchive, cameras: int) -> list[MovementModel]:
    """One for each camera."""
    vocabulary = Vocabulary(labels_of(learned))
    return [learn_view(learned, camera(n), vocabulary, placement=PersonPlacement()) for n in range(cameras)]


def pairs_of(people: str) -> list[tuple[str, str]]:
    """Each person with the next one."""
    ids = people.split(",")
    return list(pairwise([*ids, ids[0]])) if len(ids) > 2 else [(ids[0], ids[1])]


def _of_rows(recording: Recording, rows: Sequence[int]) -> Recording:
    return Recording(recording.positions[:, rows], recording.rate_hz, recording.label, recording.subject,
                     recording.trial, recording.spans)  # fmt: skip


def trial_of(
    data: MotionArchive, models: Sequence[MovementModel], pair: tuple[str, str], apart: float, takes: int, seed: int
) -> Trial:
    """These two, each with `takes` recordings of each of their movements in a random order."""
    rng = np.random.default_rng(seed)
    aside = ASIDE_M * rng.choice([-1, 1])
    places = np.array([apart / 2, 0.0]), np.array([-apart / 2, 0.0])
    parts = []
    for number, subject in enumerate(pair):
        own = [r for r in data.recordings if r.subject == subject]
        chosen = [r for label in labels_of(data) for r in [r for r in own if r.label == label][:takes]]
        chosen = [chosen[i] for i in rng.permutation(len(chosen))]
        there = places if number == 0 else places[::-1]
        parts.append(performed(chosen, WHOLE_BODY, (there[0], there[1]), aside * (1 - 2 * number), rng))
    return Trial(models, together(*parts), data.recordings[0].rate_hz, apart)


if __name__ == "__main__":
    sys.exit(run_command(main, "people"))
