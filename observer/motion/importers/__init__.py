"""Importers of other formats, one file each, by name."""

from pathlib import Path

from common.errors import BadInput
from common.text import nearest
from observer.motion.archive import MotionArchive, Recording
from observer.motion.archive_file import read_archive
from observer.motion.importers import bvh, csv_table, florence3d, msr_action3d
from observer.motion.importers.base import (
    Importer,
    ImportResult,
    Progress,
    counted,
    files_at,
    require_same_parts,
)
from observer.motion.projected import require_same_camera

__all__ = ["IMPORTERS", "ImportResult", "Importer", "Progress", "import_recordings"]


def import_archives(path: Path, progress: Progress | None = None) -> ImportResult:
    """The archive `path`, or every archive in this folder (or just below it), as one.

    Raises BadInput for a broken archive, other body parts than the first has, tracks of another camera, and a recording
    that two archives have.
    """
    files = files_at(path, "*.npz", "motion archives (.npz)")
    archives: list[MotionArchive] = []
    places: dict[tuple[str, str, str], Path] = {}
    for file in counted(files, len(files), progress):
        archive = read_archive(file)
        archives.append(archive)
        require_same_parts(file, archive.body_parts, files[0], archives[0].body_parts)
        require_same_camera(archives[0], archive, str(file))
        for recording in archive.recordings:
            _require_new(recording, file, places)
    recordings = tuple(recording for archive in archives for recording in archive.recordings)
    return ImportResult(MotionArchive(archives[0].body_parts, recordings, archives[0].camera))


def _require_new(recording: Recording, file: Path, places: dict[tuple[str, str, str], Path]) -> None:
    """Raise BadInput for a recording that another file has; one file may hold a recording twice."""
    key = recording.label, recording.subject, recording.trial
    if places.setdefault(key, file) != file:
        raise BadInput(f"{file}: {' '.join(filter(None, key))} is also in {places[key]}; another trial is expected")


IMPORTERS: dict[str, Importer] = {
    "msr-action3d": msr_action3d.import_folder,
    "florence3d": florence3d.import_folder,
    "bvh": bvh.import_files,
    "csv": csv_table.import_files,
    "archive": import_archives,
}
"""KIND of `labanmesh import KIND PATH` -> importer. A new kind is one new file and one line here."""


def import_recordings(kind: str, path: Path, progress: Progress | None = None) -> ImportResult:
    """The recordings at `path`, a folder or file of this kind, as one valid archive, with notes.

    progress: called with (done, total) now and then. Raises BadInput for an unknown kind and for every defect of the
    files, one line with the file, the place in it and what is expected.
    """
    if kind not in IMPORTERS:
        raise BadInput(f"kind {kind!r}: unknown; {nearest(kind.lower(), IMPORTERS)}")
    return IMPORTERS[kind](path, progress)
