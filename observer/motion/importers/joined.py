"""Motion archives themselves: several become one, and positions in 3-D become tracks of a camera with --seen-from."""

from pathlib import Path

from common.errors import BadInput
from observer.motion.archive import MotionArchive, Recording
from observer.motion.archive_file import read_archive
from observer.motion.importers.base import ImportResult, Progress, counted, files_at, require_same_parts
from observer.motion.projected import require_same_camera


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
