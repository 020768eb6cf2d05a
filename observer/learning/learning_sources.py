"""Which archives `labanmesh learn` reads for each model."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from common.config import Scene, read_scene
from common.errors import BadInput, reason_of
from common.text import split_list
from observer.files import require_writable_path
from observer.geometry.placement import PersonPlacement, parse_place, placement_of
from observer.geometry.views import View
from observer.learning.examples import gather_background
from observer.learning.learn_options import LearnOptions
from observer.learning.taught_takes import AUTO, parts_to_learn
from observer.motion.archive import MotionArchive, common_rate, labels_of, select
from observer.motion.archive_file import read_archive
from observer.motion.label_sets import labels_in
from observer.motion.projected import require_same_camera
from observer.motion.sensors import SensorFile, parse_sensors


@dataclass(frozen=True, slots=True)
class LearningSource:
    """The input from which one model is learned. name: of the sensor, "" for a single archive; placement: of the person
    in the room of a camera file; body_parts: those that the model reads."""

    name: str
    placement: PersonPlacement | None
    archive: MotionArchive
    view: View
    background: MotionArchive | None
    provenance: Mapping[str, str]
    body_parts: tuple[str, ...]

    @property
    def labels(self) -> tuple[str, ...]:
        """All movements of the archive."""
        return labels_of(self.archive)


def read_sources(options: LearnOptions) -> list[LearningSource]:
    """Read the archives of each sensor, each observer of the scene, or the archive; raises BadInput for a mixture."""
    return [_read_source(sensor, options) for sensor in _sensors_to_learn(options)]


def _sensors_to_learn(options: LearnOptions) -> list[SensorFile]:
    placement = placement_of(parse_place(options.place), options.facing)
    if options.observers and not options.scene:
        raise BadInput("--observers: of which scene? name it with --scene")
    scene = read_scene(options.scene) if options.scene else None
    if options.sensor:
        if options.archive or options.view or scene:
            raise BadInput("--sensor: takes the place of ARCHIVE and --view, or --scene; omit these")
        if placement:
            raise BadInput(
                "--place, --facing: sensors record in their own axes; give ARCHIVE --view in place of --sensor"
            )
        sensors = parse_sensors(options.sensor)
    elif scene is not None:
        if options.archive is None:
            raise BadInput("ARCHIVE: needed, as in: labanmesh learn own.npz --scene scene.toml -o models")
        if options.view or placement:
            raise BadInput("--scene: the scene file has view, place and facing; omit --view, --place and --facing")
        names = split_list("--observers", options.observers) or scene.roster
        sensors = [_of_observer(scene, name, options.archive) for name in names]
    elif options.archive is None:
        raise BadInput("ARCHIVE: needed, as in: labanmesh learn own.npz --view door -o cam1.model")
    else:
        require_writable_path(options.output)
        return [SensorFile("", options.archive, options.view, placement)]
    if options.edits:
        option = "--sensor" if options.sensor else "--scene"
        raise BadInput(f"{option}: only for new models of movements; --add-to and --effort take ARCHIVE --view")
    try:
        options.output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"cannot make the folder {options.output}: {reason_of(error)}. Choose another with -o") from None
    return sensors


def _of_observer(scene: Scene, name: str, archive: Path) -> SensorFile:
    """The archive as an observer's view shows it, with the people where the scene says that they stand."""
    view, person = scene.observer(name).view.strip(), scene.person_for(name)
    if not view.endswith(".toml"):
        return SensorFile(name, archive, view)
    return SensorFile(name, archive, str(scene.place(view)), placement_of(person.place, person.facing))


def _read_source(sensor: SensorFile, options: LearnOptions) -> LearningSource:
    whole = select(read_archive(sensor.path), split_list("--subjects", options.subjects), options.rate)
    if not (sensor.name or sensor.view or whole.camera):
        raise BadInput(f"--view: needed, as in: labanmesh learn {sensor.path} --view door -o cam1.model")
    provenance = {
        "archive": sensor.path.name,
        "archive_sha256": hashlib.sha256(sensor.path.read_bytes()).hexdigest(),
        "subjects": ",".join(sorted({r.subject for r in whole.recordings})),
    }
    parts = parts_to_learn(whole) if options.parts == (AUTO,) else options.parts or whole.body_parts
    learned_too = _read_background(options, sensor.path, whole, parts)
    view = sensor.view_in(whole)
    if sensor.placement and not view.has_place:
        raise BadInput(f"--place, --facing: for camera files only, and {view.name} is none; write --view yaw:DEG")
    return LearningSource(sensor.name, sensor.placement, whole, view, learned_too, provenance, parts)


def _read_background(
    options: LearnOptions, learned: Path, archive: MotionArchive, body_parts: tuple[str, ...]
) -> MotionArchive | None:
    """The recordings of --background and --background-labels; None without a background.

    learned: path of the archive to learn from, `archive` its selected recordings; if it is also a background, only its
    --subjects are taken. Raises BadInput for labels without an archive, and for what cannot be read or gathered.
    """
    background, chosen = options.background, labels_in(options.background_labels, "--background-labels")
    if background == "blends":
        raise BadInput("--background blends: every model learns blends by itself; leave it out, or name an archive")
    if chosen and not background:
        raise BadInput(f"--background-labels {options.background_labels}: of which archive? name it with --background")
    if not background:
        return None
    subjects = split_list("--subjects", options.subjects)
    paths = [Path(name) for name in split_list("--background", background)]
    archives = [select(read_archive(p), subjects if p.resolve() == learned.resolve() else ()) for p in paths]
    for path, other in zip(paths, archives, strict=True):
        require_same_camera(archive, other, f"--background {path}")
    return gather_background(archives, chosen, body_parts, common_rate(archive))
