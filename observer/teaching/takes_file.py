"""The takes of one observer on its disk: an archive of its tracks, and a note of the teaching that is not finished.

Nothing is lost when the observer is killed or the disk is full: each take is written at once, completely or not at
all; one that cannot be written waits in memory for the next attempt. Takes of earlier lessons are set aside
(`observer.teaching.earlier_takes_file`). What is to be forgotten goes also when nothing can be written.
"""

import json
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from common.errors import BadInput, LabanmeshError
from common.message_types import LAST_INTEGER
from common.teaching_messages import EarlierTakes, Unwanted
from observer.files import PRIVATE, make_private, remove_file, write_file
from observer.motion.archive import MotionArchive, Recording, TracksCamera
from observer.motion.archive_file import read_archive, write_archive
from observer.recording.new_recording import with_trial
from observer.recording.own_tracks import in_parts
from observer.teaching.earlier_takes_file import EarlierSets, TakesSet


class TracksFile:
    """The archive of one observer's tracks. Each change is written at once, completely or not at all.

    It has these parts and those of an existing file, whose recordings have not seen the new ones. Raises BadInput for a
    file that is broken, holds 3-D positions or the tracks of another camera.
    """

    def __init__(self, path: Path, body_parts: Sequence[str], camera: TracksCamera) -> None:
        self.path, self.body_parts, self._camera = path, tuple(body_parts), camera
        self.archive = self._widened(read_archive(path)) if path.exists() else None
        """None while there is no recording: then there is no file either."""

    def _widened(self, archive: MotionArchive) -> MotionArchive:
        theirs = archive.camera
        if theirs is None:
            raise BadInput(f"{self.path}: holds positions in 3-D, not tracks of one camera")
        if theirs.name and self._camera.name and theirs.name != self._camera.name:
            raise BadInput(f"{self.path}: holds the tracks of {theirs.name}, not of {self._camera.name}")
        more = (part for part in archive.body_parts if part not in self.body_parts)
        self.body_parts = (*self.body_parts, *more)
        recordings = tuple(in_parts(r, archive.body_parts, self.body_parts) for r in archive.recordings)
        return MotionArchive(self.body_parts, recordings, self._camera)

    @property
    def recordings(self) -> tuple[Recording, ...]:
        """All recordings, in the order in which they were added."""
        return self.archive.recordings if self.archive else ()

    def with_trial(self, recording: Recording, recorded: Sequence[str]) -> Recording:
        """A recording of these parts, with all of the file and its trial: its own, or the next free number.

        Raises BadInput for an invalid label or subject, another rate than the file's, and a trial that it already has.
        """
        return with_trial(in_parts(recording, recorded, self.body_parts), self.archive, self.body_parts, str(self.path))

    def add(self, recording: Recording) -> None:
        """Write the file with one more recording, as `with_trial` returns it.

        Raises BadInput or LabanmeshError if it cannot be written (a full disk): then the file is as before.
        """
        grown = MotionArchive(self.body_parts, (*self.recordings, recording), self._camera)
        write_archive(self.path, grown, PRIVATE)
        self.archive = grown

    def remove(self, unwanted: Callable[[Recording], bool]) -> None:
        """Write the file without these recordings. An empty file is deleted.

        Where the disk has no room for a second file, the old one is removed first: what is to be forgotten goes in any
        case. Raises LabanmeshError if it cannot be removed, or nothing can be written in its place: then `archive` is
        None, and the file is gone.
        """
        left = tuple(r for r in self.recordings if not unwanted(r))
        if self.archive is None or len(left) == len(self.recordings):
            return
        shrunk = replace(self.archive, recordings=left)
        try:
            if left:
                write_archive(self.path, shrunk, PRIVATE)
                self.archive = shrunk
                return
        except LabanmeshError:
            pass
        remove_file(self.path)
        self.archive = None
        if left:
            write_archive(self.path, shrunk, PRIVATE)
            self.archive = shrunk


FREE_TAKES_SPACE = "Free some space on that disk; the take waits in memory"


class TakesFile:
    """The file `path` (.npz) of the takes of `camera`, and beside it the note (.json) of an unfinished teaching.

    earlier: where the takes were before they got a folder of their own (LABANMESH_MODELS); only `forget` reaches them.
    body_parts: of the recordings that are added. In a file of other parts, as after a change of tracker, what is
    unknown of a recording counts as not seen.
    """

    def __init__(
        self, path: Path, body_parts: Sequence[str], camera: TracksCamera, earlier: Path | None = None
    ) -> None:
        self.path, self._parts, self._camera, self._earlier = path, tuple(body_parts), camera, earlier or path
        self._set, self._sets = TakesSet(path), EarlierSets(path)
        self._file: TracksFile | None = None
        self._waiting: list[Recording] = []
        self._restored = ""
        for each in (self._set, *self._sets.sets.values()):
            # They may be of a version that let everybody read them.
            make_private(each.path)
            make_private(each.note)

    def start(self, labels: Sequence[str], *, add: bool, lesson: str) -> None:
        """Begin to teach these movements, or go on with them if that was interrupted.

        add: with the takes of all earlier movements; otherwise these are set aside because `lesson`, the id of its
        teacher, begins. Raises BadInput for a file that cannot be used, LabanmeshError if it cannot be written.
        """
        if self._set.unfinished != list(labels) and not add:
            self._sets.set_aside(lesson)
            self._sets.resume(labels)
            self._file = None
            self._sets.thin_out()
        self._write_note(labels)

    def finish(self) -> None:
        """Note that the movements are learned and adopted: the next teaching starts anew."""
        if (labels := self._set.unfinished) is not None:
            self._sets.ended_well(labels)
        self._set.note.unlink(missing_ok=True)

    @property
    def earlier(self) -> list[EarlierTakes]:
        """The takes that were set aside, the newest last."""
        return self._sets.reports()

    def restore(self, wanted: str, lesson: str) -> None:
        """Earlier takes become the takes again, and those of now are set aside; a repeated request changes nothing.

        The next lesson with their movements goes on with them. Raises BadInput for an unknown id, LabanmeshError.
        """
        if wanted == self._restored and wanted not in self._sets.sets:
            return
        labels = self._sets.restore(wanted, lesson)
        self._file, self._restored = None, wanted
        self._sets.thin_out()
        self._write_note(labels)

    def _write_note(self, labels: Sequence[str]) -> None:
        write_file(self._set.note, json.dumps({"labels": list(labels)}).encode(), FREE_TAKES_SPACE, PRIVATE)

    def add(self, recording: Recording) -> None:
        """Write one more take; raises LabanmeshError if the disk is full: then it waits in memory."""
        self._waiting.append(recording)
        self.write_waiting()

    def write_waiting(self) -> None:
        """Write the takes that wait in memory; raises BadInput or LabanmeshError as `TracksFile` does."""
        while self._waiting:
            file = self._opened()
            try:
                take = file.with_trial(self._waiting[0], self._parts)
            except BadInput:
                self._waiting.pop(0)
                raise
            file.add(take)
            self._waiting.pop(0)

    def drop(self, label: str, trial: str) -> int:
        """Remove a take; returns how many there were."""
        before = len(self._waiting)
        self._waiting = [r for r in self._waiting if (r.label, r.trial) != (label, trial)]
        gone = before - len(self._waiting)
        return gone + len(self._remove(self._opened(), lambda r: (r.label, r.trial) == (label, trial)))

    def free_take(self, label: str) -> int:
        """The number after the highest that a take of the movement has, on the disk or in memory."""
        trials = [r.trial for r in (*self.recordings, *self._waiting) if r.label == label]
        return max((int(trial) for trial in trials if trial.isdecimal()), default=0) + 1

    def forget(self, unwanted: Unwanted) -> list[Recording]:
        """Remove recordings from the file, from those that were set aside or earlier, and from memory; returns them.

        Raises LabanmeshError for files that cannot be read or removed; the others are without them then.
        """
        gone = [r for r in self._waiting if unwanted.covers(r.subject, r.label)]
        self._waiting = [r for r in self._waiting if not unwanted.covers(r.subject, r.label)]
        old = EarlierSets(self._earlier).sets.values()
        faults = []
        for each in dict.fromkeys((self._set, TakesSet(self._earlier), *self._sets.sets.values(), *old)):
            try:
                gone += self._forget_in(each, unwanted)
            except LabanmeshError as error:
                faults.append(str(error))
        if faults:
            raise LabanmeshError("; ".join(sorted(faults)))
        return gone

    def _forget_in(self, takes: TakesSet, unwanted: Unwanted) -> list[Recording]:
        is_current = takes.path == self.path
        if unwanted.everything:
            # Also what cannot be read.
            gone = takes.archive.recordings if takes.archive else ()
            takes.remove()
            self._file = None if is_current else self._file
            return list(gone)
        removed: Sequence[Recording] = ()
        if takes.path.exists():
            file = self._opened() if is_current else TracksFile(takes.path, self._parts, self._camera)
            removed = self._remove(file, lambda r: unwanted.covers(r.subject, r.label))
        if unwanted.label in (takes.unfinished or ()) or (removed and not takes.path.exists()):
            remove_file(takes.note)
        return list(removed)

    def _remove(self, file: TracksFile, unwanted: Callable[[Recording], bool]) -> list[Recording]:
        """Remove recordings from a file; if nothing can be written in its place, what stays waits in memory."""
        recordings = file.recordings
        try:
            file.remove(unwanted)
        except LabanmeshError:
            if file.archive is not None or file is not self._file:
                raise
            staying = [in_parts(r, file.body_parts, self._parts) for r in recordings if not unwanted(r)]
            self._waiting = [*staying, *self._waiting]
        return [r for r in recordings if unwanted(r)]

    def take(self, label: str, trial: str) -> Recording | None:
        """A take, on the disk or in memory, with the parts of this observer; None if there is none."""
        stored = self.archive
        on_disk = () if stored is None else (in_parts(r, stored.body_parts, self._parts) for r in stored.recordings)
        return next((r for r in (*on_disk, *self._waiting) if (r.label, r.trial) == (label, trial)), None)

    @property
    def recordings(self) -> Sequence[Recording]:
        """All that is on the disk, in the order in which it was added; empty if it cannot be read."""
        with suppress(LabanmeshError):
            return self._opened().recordings
        return ()

    @property
    def archive(self) -> MotionArchive | None:
        """All that is on the disk; None if nothing is, or if it cannot be read."""
        with suppress(LabanmeshError):
            return self._opened().archive
        return None

    @property
    def takes(self) -> dict[str, list[int]]:
        """The numbers of the takes of each movement on the disk."""
        result: dict[str, list[int]] = {}
        for recording in self.recordings:
            if recording.label and recording.trial.isdecimal() and int(recording.trial) <= LAST_INTEGER:
                result.setdefault(recording.label, []).append(int(recording.trial))
        return result

    @property
    def persons(self) -> dict[str, dict[str, int]]:
        """How many recordings of each movement ("": something else) are on the disk or in memory, by whose they are."""
        own = [r for r in (*self.recordings, *self._waiting) if r.subject]
        return {
            name: dict(Counter(r.label for r in own if r.subject == name)) for name in sorted({r.subject for r in own})
        }

    @property
    def other_s(self) -> float:
        """Seconds of something else on the disk."""
        return sum(len(r.positions) / r.rate_hz for r in self.recordings if not r.label)

    def _opened(self) -> TracksFile:
        if self._file is None:
            self._file = TracksFile(self.path, self._parts, self._camera)
        return self._file
