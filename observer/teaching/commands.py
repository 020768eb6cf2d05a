"""The command `labanmesh teach --film`: own movements for one observer, from films instead of a lesson."""

import shutil
import tempfile
import threading
from collections.abc import Collection, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.errors import BadInput, LabanmeshError
from common.text import periods_line, plural

if TYPE_CHECKING:
    from common.config import Scene
    from common.teaching_messages import LearnedReport
    from observer.teaching.film_takes import TaughtFilm
    from observer.teaching.model_learner import ModelLearner
    from observer.teaching.takes_file import TakesFile

RUNS_S, STOP_LOOK_S = 1.0, 0.1
"""An observer that runs is found within milliseconds. While a model is learned, Ctrl-C is looked for that often."""


def teach_from_films(
    scene: Annotated[Path, typer.Argument(help="The scene file; the observer that is taught must not run.")],
    film: Annotated[
        list[str],
        typer.Option(
            metavar="LABEL=FILM",
            help="A film of a movement, once or several times with rest between; of ordinary life: nothing=FILM.",
        ),
    ],
    observer: Annotated[
        str, typer.Option(help="Whose camera took the films, or one at its place; needed if there are several.")
    ] = "",
    person: Annotated[str, typer.Option(help="Who performs; by default someone.")] = "",
    add: Annotated[bool, typer.Option("--add", help="Keep the movements that were taught before.")] = False,
) -> None:
    """Teach an observer movements from films, without a camera: it finds the takes in them and learns, as in a lesson.

    The films are tracked as the scene file says for this observer, faster than real time where the tracker allows it.

    Example: labanmesh teach scene.toml --film wave=wave.mp4 --film clap=clap.mp4

    Example: labanmesh teach scene.toml --observer sofa --film nod=nod.mp4 --film nothing=evening.mp4 --add
    """
    from common.config import read_scene
    from common.lifecycle import stop_on_signals
    from observer.teaching.film_takes import TaughtFilm, labels_of

    config = read_scene(scene)
    films = [TaughtFilm.parse(text) for text in film]
    taught, labels = _chosen(config, observer), labels_of(films)
    _require_teachable(config, taught, labels, add=add)
    with stop_on_signals() as stop, tempfile.TemporaryDirectory() as folder:
        _require_idle(config, taught, stop)
        _teach(config, taught, films, Path(folder) / "films.npz", person, stop, add=add)
    print(f"see it: labanmesh up {scene}, and labanmesh watch {scene} in another terminal")


def _teach(
    scene: "Scene",
    observer: str,
    films: "Sequence[TaughtFilm]",
    work: Path,
    person: str,
    stop: threading.Event,
    *,
    add: bool,
) -> None:
    """Find the takes, learn from them and, if that succeeds, keep both. work: a file to work with."""
    from common.teaching_messages import SOMEONE
    from observer.commands import pipeline_of
    from observer.teaching.film_takes import add_takes, labels_of, open_film
    from observer.teaching.model_learner import ModelLearner
    from observer.teaching.service import scene_model_of, takes_of

    inputs = open_film(scene, observer, films[0])
    takes = takes_of(scene, observer, inputs.tracker.every_part)
    working = _working_copy(takes, work, observer, inputs.tracker.every_part, add=add)
    earlier = len(working.recordings)
    for number, film in enumerate(films):
        played = open_film(scene, observer, film) if number else inputs
        print(_found_line(film, add_takes(film, played, working, person or SOMEONE, stop)), flush=True)
    labels = _vocabulary(scene, observer, labels_of(films), working.takes if add else {})
    build = partial(pipeline_of, scene, observer, inputs)
    learner = ModelLearner(work, scene.taught_model(observer), build, scene_model_of(scene, observer))
    try:
        report = _learned(learner, labels, stop)
        takes.start(labels, add=add, lesson="films")
        for take in working.recordings[earlier:]:
            takes.add(take)
        learner.adopt(0.0)
        takes.finish()
    finally:
        learner.close()
    _print_learned(observer, report, labels)


def _working_copy(takes: "TakesFile", work: Path, observer: str, parts: Sequence[str], *, add: bool) -> "TakesFile":
    """A file in `work` for the new takes; add: it begins with those that are kept."""
    from observer.motion.archive import TracksCamera
    from observer.teaching.takes_file import TakesFile

    if add and takes.path.exists():
        shutil.copy(takes.path, work)
    return TakesFile(work, parts, TracksCamera(observer))


def _print_learned(observer: str, report: "LearnedReport", labels: Sequence[str]) -> None:
    print(f"{observer}: {_result_line(report)}, of takes that were left out")
    if report.periods:
        print(periods_line(report.periods))
    print(f"{observer} recognises {', '.join(labels)} from its next start on")


def _result_line(report: "LearnedReport") -> str:
    """How many takes of each movement were recognised."""
    rows = {label: report.results.get(label, {}) for label in report.labels}
    known = [f"{label} {row.get(label, 0)} of {sum(row.values())}" for label, row in rows.items() if row]
    return ", ".join(known) or "learned"


def _learned(learner: "ModelLearner", labels: "Sequence[str]", stop: threading.Event) -> "LearnedReport":
    """What was learned; raises LabanmeshError, and KeyboardInterrupt as soon as `stop` is set."""
    print("learning ...", flush=True)
    learner.learn(labels)
    while learner.busy:
        if stop.wait(STOP_LOOK_S):
            raise KeyboardInterrupt
    if learner.learned is None:
        raise LabanmeshError(f"{learner.fault}; nothing has changed")
    return learner.learned


def _found_line(film: "TaughtFilm", seconds: Sequence[float]) -> str:
    if not film.label:
        return f"{film.path.name}: {sum(seconds):.0f} s of ordinary life"
    return (
        f"{film.path.name}: {plural(len(seconds), 'take')} of {film.label} ({', '.join(f'{s:.1f} s' for s in seconds)})"
    )


def _vocabulary(scene: "Scene", observer: str, labels: Sequence[str], recorded: Collection[str]) -> list[str]:
    """`labels`, after those of the model in force and others that have takes."""
    from observer.model.model_file import read_model

    model = scene.model_file(observer)
    in_force = read_model(model).header.vocabulary.labels if model.exists() else ()
    return list(dict.fromkeys((*(label for label in in_force if label in recorded), *sorted(recorded), *labels)))


def _chosen(scene: "Scene", observer: str) -> str:
    """The observer that is taught; raises BadInput unless it is named or the only one."""
    if observer:
        scene.observer(observer)
        return observer
    if len(scene.roster) > 1:
        names = ", ".join(scene.roster)
        raise BadInput(f"the scene has {names}: say from whose place the films are, e.g. --observer {scene.roster[0]}")
    return scene.roster[0]


def _require_teachable(scene: "Scene", observer: str, labels: Sequence[str], *, add: bool) -> None:
    from common.vocabulary import require_teachable
    from observer.teaching.service import why_not

    if not labels:
        raise BadInput("--film: at least one film of a movement is needed, e.g. --film wave=wave.mp4")
    if len(labels) == 1 and not add:
        raise BadInput(
            f"{labels[0]}: one movement alone cannot be told from another; give films of at least two, or add it with "
            "--add to those that were taught"
        )
    require_teachable(labels)
    if refusal := why_not(scene, observer):
        raise BadInput(refusal)


def _require_idle(scene: "Scene", observer: str, stop: threading.Event) -> None:
    """Raise BadInput if the observer runs: it would go on with what it knows, and may write the same files."""
    from common.link import Link

    runs, key = False, scene.keys.observer_alive(observer)
    # Without a mesh to ask, nothing runs.
    with suppress(LabanmeshError), Link.open(scene.mesh, "hub", scene=scene.scene, stop=stop) as link:
        runs = link.presence(key, [key]).wait_for(1, RUNS_S)
    if runs:
        raise BadInput(
            f"{observer}: runs now, and can be taught before its camera; or end it first, and teach it from films then"
        )
