"""The file of one observer's own tracks: takes are added and removed one by one, and nothing is ever half written."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from common.errors import BadInput, LabanmeshError
from observer.files import SHARED, remove_file
from observer.motion.archive import MotionArchive, Recording, TracksCamera
from observer.motion.archive_file import read_archive, write_archive
from observer.recording.new_recording import appended, with_trial
from observer.recording.own_tracks import in_parts


class TracksFile:
    """The archive of one observer's tracks. Each change is written at once, completely or not at all.

    An existing file is extended. mode: of the file, as `observer.files.write_file` has it. Raises BadInput for a file
    that is broken, holds 3-D positions, other body parts or the tracks of another camera.
    """

    def __init__(self, path: Path, body_parts: Sequence[str], camera: TracksCamera, mode: int = SHARED) -> None:
        self.path, self.body_parts, self.camera, self._mode = path, tuple(body_parts), camera, mode
        self.archive: MotionArchive | None = read_archive(path) if path.exists() else None
        """None while there is no recording: then there is no file either."""
        if self.archive is None:
            return
        theirs = self.archive.camera
        if theirs is None:
            raise BadInput(f"{path}: holds positions in 3-D, not tracks of one camera; choose another file with -o")
        if theirs.name and camera.name and theirs.name != camera.name:
            raise BadInput(
                f"{path}: holds the tracks of {theirs.name}, not of {camera.name}; choose another file with -o"
            )

    @property
    def recordings(self) -> tuple[Recording, ...]:
        """All recordings, in the order in which they were added."""
        return self.archive.recordings if self.archive else ()

    def widen(self, body_parts: Sequence[str]) -> None:
        """Let recordings have these parts and those of the file; what is there has not seen the new ones.

        The file is written with the next recording.
        """
        if self.archive is None or self.archive.body_parts == tuple(body_parts):
            return
        theirs = self.archive.body_parts
        self.body_parts = (*body_parts, *(part for part in theirs if part not in body_parts))
        recordings = tuple(in_parts(r, theirs, self.body_parts) for r in self.archive.recordings)
        self.archive = replace(self.archive, body_parts=self.body_parts, recordings=recordings)

    def with_trial(self, recording: Recording) -> Recording:
        """The recording, with or without frames, with its trial: its own, or the next free number.

        Raises BadInput for an invalid label or subject, another rate than the file's, and a trial that it already has.
        """
        return with_trial(recording, self.archive, self.body_parts, str(self.path))

    def add(self, recording: Recording) -> Recording:
        """Write the file with one more recording; returns it with its trial.

        Raises BadInput as `with_trial` does, and BadInput or LabanmeshError if it cannot be written (a full disk): then
        the file is as before.
        """
        recording = self.with_trial(recording)
        grown = replace(appended(self.archive, self.body_parts, recording), camera=self.camera)
        write_archive(self.path, grown, self._mode)
        self.archive = grown
        return recording

    def remove(self, unwanted: Callable[[Recording], bool]) -> int:
        """Write the file without these recordings; returns how many were removed. An empty file is deleted.

        Where the disk has no room for a second file, the old one is removed first: what is to be forgotten goes in any
        case. Raises LabanmeshError if it cannot be removed, or nothing can be written in its place: then `archive` is
        None, and the file is gone.
        """
        left = tuple(r for r in self.recordings if not unwanted(r))
        removed = len(self.recordings) - len(left)
        if removed and left and self.archive is not None:
            shrunk = replace(self.archive, recordings=left)
            try:
                write_archive(self.path, shrunk, self._mode)
            except LabanmeshError:
                remove_file(self.path)
                self.archive = None
                write_archive(self.path, shrunk, self._mode)
            self.archive = shrunk
        elif removed:
            remove_file(self.path)
            self.archive = None
        return removed
