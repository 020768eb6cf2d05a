"""Which archives `labanmesh learn` reads for each model."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from common.config import Scene
from common.errors import BadInput, reason_of
from common.text import split_list
from observer.geometry.placement import PersonPlacement, placement_of
from observer.geometry.views import View
from observer.learning.examples import gather_background
from observer.learning.learn import BLENDS
from observer.learning.part_selection import AUTO, parts_to_learn
from observer.motion.archive import MotionArchive, common_rate, labels_of, select
from observer.motion.archive_file import read_archive
from observer.motion.projected import require_same_camera
from observer.motion.sensors import SensorFile, parse_sensors


@dataclass(frozen=True, slots=True)
class LearningSource:
    """The input from which one model is learned. body_parts: those that the model reads."""

    archive: MotionArchive
    view: View
    background: MotionArchive | None
    provenance: Mapping[str, str]
    body_parts: tuple[str, ...]

    @property
    def labels(self) -> tuple[str, ...]:
        """All movements of the archive."""
        return labels_of(self.archive)


@dataclass(frozen=True, slots=True)
class SourceChoice:
    """The options of `labanmesh learn` that say which models to learn, and from what.

    archive with view, with a scene, or sensors (`--sensor`). output: a folder, except with a view. edits: the model is
    not a new one of movements.
    """

    archive: Path | None
    view: str
    sensors: Sequence[str]
    scene: Scene | None
    observers: Sequence[str]
    placement: PersonPlacement | None
    output: Path
    edits: bool


def sensors_to_learn(choice: SourceChoice) -> list[SensorFile]:
    """The sensors, the observers of the scene, or the archive as the only one; raises BadInput for another mixture."""
    if choice.sensors:
        sensors = _of_sensors(choice)
    elif choice.scene is not None:
        sensors = _of_scene(choice, choice.scene)
    elif choice.archive is None:
        raise BadInput("ARCHIVE: needed, as in: labanmesh learn own.npz --view door -o cam1.model")
    else:
        return [SensorFile("", choice.archive, choice.view, choice.placement)]
    if choice.edits:
        option = "--sensor" if choice.sensors else "--scene"
        raise BadInput(f"{option}: only for new models of movements; --add-to and --effort take ARCHIVE --view")
    try:
        choice.output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"cannot make the folder {choice.output}: {reason_of(error)}. Choose another with -o") from None
    return sensors


def _of_sensors(choice: SourceChoice) -> list[SensorFile]:
    if choice.archive or choice.view or choice.scene:
        raise BadInput("--sensor: takes the place of ARCHIVE and --view, or --scene; omit these")
    if choice.placement:
        raise BadInput("--place, --facing: sensors record in their own axes; give ARCHIVE --view in place of --sensor")
    return parse_sensors(choice.sensors)


def _of_scene(choice: SourceChoice, scene: Scene) -> list[SensorFile]:
    """One for each observer: its view, and where the scene says that the person stands."""
    if choice.archive is None:
        raise BadInput("ARCHIVE: needed, as in: labanmesh learn own.npz --scene scene.toml -o models")
    if choice.view or choice.placement:
        raise BadInput("--scene: the scene file has view, place and facing; omit --view, --place and --facing")
    sensors = []
    for name in choice.observers or scene.roster:
        view, person = scene.observer(name).view.strip(), scene.person_for(name)
        if view.endswith(".toml"):
            placement = placement_of(person.place, person.facing)
            sensors.append(SensorFile(name, choice.archive, str(scene.place(view)), placement))
        else:
            sensors.append(SensorFile(name, choice.archive, view))
    return sensors


def read_source(
    sensor: SensorFile,
    people: Sequence[str],
    rate: float | None,
    body_parts: tuple[str, ...],
    background: tuple[str, str],
) -> LearningSource:
    """Read the archives of one sensor. background: the values of --background and --background-labels."""
    whole = select(read_archive(sensor.path), people, rate)
    if not (sensor.name or sensor.view or whole.camera):
        raise BadInput(f"--view: needed, as in: labanmesh learn {sensor.path} --view door -o cam1.model")
    provenance = {
        "archive": sensor.path.name,
        "archive_sha256": hashlib.sha256(sensor.path.read_bytes()).hexdigest(),
        "subjects": ",".join(sorted({r.subject for r in whole.recordings})),
    }
    parts = parts_to_learn(whole) if body_parts == (AUTO,) else body_parts or whole.body_parts
    learned_too = _read_background(*background, sensor.path, whole, people, parts)
    view = sensor.view_in(whole)
    if sensor.placement and not view.has_place:
        raise BadInput(f"--place, --facing: for camera files only, and {view.name} is none; write --view yaw:DEG")
    return LearningSource(whole, view, learned_too, provenance, parts)


def _read_background(
    background: str,
    labels: str,
    learned: Path,
    archive: MotionArchive,
    subjects: Sequence[str],
    body_parts: tuple[str, ...],
) -> MotionArchive | None:
    """The recordings of --background and --background-labels; None without a background.

    learned: path of the archive to learn from, `archive` its selected recordings; if it is also a background, only the
    `subjects` are taken. Raises BadInput for labels without an archive, and for what cannot be read or gathered.
    """
    chosen = split_list("--background-labels", labels)
    if chosen and background in ("", BLENDS):
        raise BadInput(f"--background-labels {labels}: of which archive? name it with --background")
    if not background:
        return None
    if background == BLENDS:
        return MotionArchive(body_parts, ())
    paths = [Path(name) for name in split_list("--background", background)]
    archives = [select(read_archive(p), subjects if p.resolve() == learned.resolve() else ()) for p in paths]
    for path, other in zip(paths, archives, strict=True):
        require_same_camera(archive, other, f"--background {path}")
    return gather_background(archives, chosen, body_parts, common_rate(archive))
