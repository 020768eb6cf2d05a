"""The takes of one observer on its disk: an archive of its tracks, and a note of the teaching that is not finished.

Nothing is lost when the observer is killed or the disk is full: each take is written at once, completely or not at
all; one that cannot be written waits in memory for the next attempt. Earlier takes are set aside, never deleted.
"""

import json
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from common.errors import BadInput, LabanmeshError
from common.message_types import LAST_INTEGER
from common.teaching_messages import Unwanted
from observer.files import remove_file, write_file
from observer.motion.archive import MotionArchive, Recording, TracksCamera
from observer.recording.own_tracks import in_parts
from observer.recording.tracks_file import TracksFile

WAY_OUT = "Free some space on that disk; the take waits in memory"


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
        self._note, self._before = path.with_suffix(".json"), path.with_suffix(".before.npz")
        self._file: TracksFile | None = None
        self._waiting: list[Recording] = []

    def start(self, labels: Sequence[str], *, add: bool) -> None:
        """Begin to teach these movements, or go on with them if that was interrupted.

        add: with the takes of all earlier movements; otherwise these are set aside in a file NAME.before.npz. Raises
        BadInput for a file that cannot be used, LabanmeshError if it cannot be written.
        """
        if _unfinished(self._note) != list(labels) and not add and self.path.exists():
            self.path.replace(self._before)
            self._file = None
        content = json.dumps({"labels": list(labels)})
        write_file(self._note, content.encode(), WAY_OUT)

    def finish(self) -> None:
        """The movements have been learned and adopted: the next teaching starts anew."""
        self._note.unlink(missing_ok=True)

    def add(self, recording: Recording) -> None:
        """Write one more take; raises LabanmeshError if the disk is full: then it waits in memory."""
        self._waiting.append(recording)
        self.write_waiting()

    def write_waiting(self) -> None:
        """Write the takes that wait in memory; raises BadInput or LabanmeshError as TracksFile.add does."""
        while self._waiting:
            file = self._opened()
            take = in_parts(self._waiting[0], self._parts, file.body_parts)
            try:
                file.with_trial(take)
            except BadInput:
                self._waiting.pop(0)
                raise
            file.add(take)
            self._waiting.pop(0)

    def drop(self, label: str, trial: str) -> int:
        """Remove a take; returns how many there were."""
        before = len(self._waiting)
        self._waiting = [r for r in self._waiting if (r.label, r.trial) != (label, trial)]
        removed = self._opened().remove(lambda r: (r.label, r.trial) == (label, trial))
        return removed + before - len(self._waiting)

    def free_take(self, label: str) -> int:
        """The number after the highest that a take of the movement has, on the disk or in memory."""
        trials = [r.trial for r in (*self.recordings, *self._waiting) if r.label == label]
        return max((int(trial) for trial in trials if trial.isdecimal()), default=0) + 1

    def forget(self, unwanted: Unwanted) -> list[Recording]:
        """Remove recordings from the file, from those that were set aside or earlier, and from memory; returns them.

        Raises BadInput or LabanmeshError for a file that cannot be read or written: then it is as before.
        """
        gone = [r for r in self._waiting if unwanted.covers(r.subject, r.label)]
        self._waiting = [r for r in self._waiting if not unwanted.covers(r.subject, r.label)]
        paths = {self._before, self._earlier, self._earlier.with_suffix(".before.npz")} - {self.path}
        old = [TracksFile(path, self._parts, self._camera) for path in sorted(paths) if path.exists()]
        for file in (self._opened(), *old):
            gone += [r for r in file.recordings if unwanted.covers(r.subject, r.label)]
            file.remove(lambda r: unwanted.covers(r.subject, r.label))
        for note in {self._note, self._earlier.with_suffix(".json")}:
            if unwanted.everything or unwanted.label in (_unfinished(note) or ()):
                remove_file(note)
        return gone

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
            self._file.widen(self._parts)
        return self._file


def _unfinished(note: Path) -> list[str] | None:
    """The movements of a teaching that is not finished; None: there is none."""
    with suppress(OSError, ValueError, TypeError, AttributeError):
        labels = json.loads(note.read_text(encoding="utf-8")).get("labels")
        return [str(label) for label in labels]
    return None
