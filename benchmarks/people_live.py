"""Two people in one room before real processes: an observer for each camera, and one fusion service. SIMULATED.

    python -m benchmarks.people_live MSR.npz --show 7,9 --seed 0

The room is that of benchmarks.people. Beside each verdict it prints whether its person has performed it, and at the end
how many movements have a right verdict; the same people judged in this process, without a mesh, are the measure.
"""

import pickle
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from subprocess import Popen
from typing import Annotated

import numpy as np
import typer

from benchmarks.command_line import run_command
from benchmarks.people import LABELS, Trial, chosen, is_right, learned_from, models_of, trial_of
from benchmarks.people_room import BEGIN_NS, Run, Stage, camera, middle_of
from common import SECOND_NS
from common.config import Scene, read_scene
from common.link import Link
from common.messages import JudgementMessage, PosteriorMessage, VerdictMessage
from common.wire import decode
from observer.geometry.camera_file import CameraModel, write_camera
from observer.model.model_file import write_model
from observer.motion.archive import MotionArchive, Recording
from observer.motion.archive_file import write_archive
from observer.tracking.person_keeper import of_people
from observer.tracks import WHOLE_BODY
from studies.demo_scene import free_port

END_S, POLL_S = 60.0, 0.1
"""How much longer than the performance the processes may take, and how long one look for messages waits."""


@dataclass(slots=True)
class Received:
    """What a listener received: of each verdict the last message."""

    verdicts: dict[str, VerdictMessage] = field(default_factory=dict)
    judgements: list[JudgementMessage] = field(default_factory=list)
    posteriors: list[tuple[str, PosteriorMessage]] = field(default_factory=list)


def write_scene(trial: Trial, folder: Path) -> Path:
    """The scene file, with the models, the camera files and the performance beside it."""
    one, other = (person.positions for person in trial.people)
    positions = np.concatenate([one, other], axis=1).astype(np.float32)
    performance = Recording(positions, trial.rate_hz, "", "both", "people")
    write_archive(folder / "people.npz", MotionArchive(of_people(WHOLE_BODY, 2), (performance,)))
    lines = [
        'scene = "people"',
        f"vocabulary = {list(trial.models[0].header.vocabulary.labels)}",
        "[mesh]",
        f'endpoint = "tcp/127.0.0.1:{free_port()}"',
    ]
    lines += ["[people]", "most = 2", "[person]", "place = [0, 0]"]
    for number, model in enumerate(trial.models):
        name, view = f"corner{number}", camera(number)
        write_model(folder / f"{name}.model", model)
        write_camera(folder / f"{name}.toml", CameraModel(name, view.matrix, view.size_px))
        lines += [f"[observers.{name}]", 'source = "people.npz"', f'view = "{name}.toml"']
    (folder / "scene.toml").write_text("\n".join(lines).replace("'", '"') + "\n")
    return folder / "scene.toml"


def receive(scene_file: Path, length_s: float) -> Received:
    """What is published while the scene runs, from the first posterior to the end of the recording."""
    scene, received = read_scene(scene_file), Received()
    keys = scene.keys
    command = [sys.executable, "-P", "-m", "labanmesh", "up", str(scene_file), "--exit-when-done"]
    log = scene_file.with_name("log.txt")
    with log.open("w", encoding="utf-8") as lines, Link.open(scene.mesh, "hub") as link:
        inbox = link.inbox(keys.posterior(), keys.judgement, keys.verdict)
        end_s = time.monotonic() + length_s + END_S
        with Popen(command, stdout=lines, stderr=lines) as up:  # noqa: S603 - our own command
            while up.poll() is None and time.monotonic() < end_s:
                for arrival in inbox.take(POLL_S):
                    _note(received, scene, arrival.key, arrival.payload)
            up.terminate()
        for arrival in inbox.take(0):
            _note(received, scene, arrival.key, arrival.payload)
    return received


def _note(received: Received, scene: Scene, key: str, payload: bytes) -> None:
    if key == scene.keys.judgement:
        received.judgements.append(decode(JudgementMessage, payload))
    elif key == scene.keys.verdict:
        verdict = decode(VerdictMessage, payload)
        received.verdicts[verdict.id] = verdict
    else:
        received.posteriors.append((key.rsplit("/", 2)[-2], decode(PosteriorMessage, payload)))


def _run_of(received: Received, begin_ns: int, trial: Trial) -> Run:
    """The same record as of people who are judged in this process."""
    run = Run([each for each in received.verdicts.values() if each.stage == "ended"])
    for judgement in received.judgements:
        if judgement.person is not None and judgement.place is not None:
            frame = round((judgement.at_ns - begin_ns) / SECOND_NS * trial.rate_hz)
            run.places.setdefault(judgement.person, []).append((frame, judgement.place[0], judgement.place[-1]))
    return run


def _print_run(title: str, run: Run, begin_ns: int, trial: Trial) -> None:
    """A line for each verdict, and the counts."""
    right, wrong, votes = set[tuple[int, int]](), 0, Counter[tuple[str, int]]()
    for number, person in enumerate(trial.people):
        names = (run.id_at(frame, middle_of(person, frame)) for frame in range(person.crossing[0]))
        votes.update((name, number) for name in names if name is not None)
    owners = dict(key for key, _ in reversed(votes.most_common()))
    for verdict in sorted(run.verdicts, key=lambda each: each.began_ns):
        number = owners.get(verdict.person or "", 0)
        person = trial.people[number]
        begin, end = ((at - begin_ns) / SECOND_NS for at in (verdict.began_ns, verdict.ended_ns or 0))
        done = [s for s in person.spans if begin * trial.rate_hz < s.end and end * trial.rate_hz > s.start]
        fits = is_right(verdict, person, trial.rate_hz, begin_ns)
        wrong += verdict.label != "abstain" and not fits
        right |= {(number, s.start) for s in done if s.label == verdict.label}
        mark = "right" if fits else "" if verdict.label == "abstain" else "WRONG"
        labels = ", ".join(s.label for s in done)
        print(f"  {title} {verdict.person} {begin:6.2f} {end:6.2f} {verdict.label:18} {mark:6} {labels}")
    total = sum(len(person.spans) for person in trial.people)
    print(f"{title}: {len(right)} of {total} right, {wrong} wrong", flush=True)


def main(
    archive: Annotated[Path, typer.Argument(help="A motion archive of the whole body.")],
    labels: Annotated[str, typer.Option(help="Movements of the vocabulary.")] = ",".join(LABELS),
    learn: Annotated[str, typer.Option(help="Whose recordings the observers learn from.")] = "1,3,5",
    show: Annotated[str, typer.Option(help="Who performs.")] = "7,9",
    apart: Annotated[float, typer.Option(help="Metres between the two.")] = 1.5,
    cameras: Annotated[int, typer.Option(help="How many cameras.")] = 2,
    seed: int = 0,
    output: Annotated[Path | None, typer.Option(help="Keep scene, log and messages in this folder.")] = None,
) -> None:
    """Print the verdicts of real processes, and those of the same people judged in this process."""
    data = chosen(archive, labels)
    one, other = show.split(",")
    trial = trial_of(data, models_of(learned_from(data, learn), cameras), (one, other), apart, 1, seed)
    positions = np.concatenate([person.positions for person in trial.people], axis=1)
    _print_run("pure", Stage(trial.models, trial.rate_hz).run(positions), BEGIN_NS, trial)
    with tempfile.TemporaryDirectory() as temporary:
        folder = output or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        received = receive(write_scene(trial, folder), len(positions) / trial.rate_hz)
        begin_ns = min(message.captured_ns for _, message in received.posteriors)
        _print_run("live", _run_of(received, begin_ns, trial), begin_ns, trial)
        if output is not None:
            (folder / "received.pickle").write_bytes(pickle.dumps((received, begin_ns, trial.people, trial.rate_hz)))


if __name__ == "__main__":
    sys.exit(run_command(main, "people_live"))
