"""Which archives `labanmesh learn` reads for each model."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from common.errors import BadInput, reason_of
from common.text import split_list
from observer.geometry.views import View
from observer.learning.examples import gather_background
from observer.learning.learn import BLENDS
from observer.motion.archive import MotionArchive, common_rate, labels_of, select
from observer.motion.archive_file import read_archive
from observer.motion.projected import require_same_camera
from observer.motion.sensors import SensorFile, parse_sensors


@dataclass(frozen=True, slots=True)
class LearningSource:
    """What one model is learned from."""

    archive: MotionArchive
    view: View
    background: MotionArchive | None
    provenance: Mapping[str, str]

    @property
    def labels(self) -> tuple[str, ...]:
        """All movements of the archive."""
        return labels_of(self.archive)


def sensors_to_learn(
    archive: Path | None, view: str, texts: Sequence[str], output: Path, edits: bool
) -> list[SensorFile]:
    """The sensors, or the archive as the only one; with sensors `output` becomes a folder."""
    if not texts:
        if archive is None:
            raise BadInput("ARCHIVE: needed, as in: labanmesh learn own.npz --view door -o cam1.model")
        return [SensorFile("", archive, view)]
    if archive or view:
        raise BadInput("--sensor: takes the place of ARCHIVE and --view; omit these")
    if edits:
        raise BadInput("--sensor: only for new models of movements; --add-to and --effort take ARCHIVE --view")
    sensors = parse_sensors(texts)
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"cannot make the folder {output}: {reason_of(error)}. Choose another one with -o") from None
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
    learned_too = _read_background(*background, sensor.path, whole, people, body_parts or whole.body_parts)
    return LearningSource(whole, sensor.view_in(whole), learned_too, provenance)


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
