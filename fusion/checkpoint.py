"""Checkpoints, from which a fusion service continues a scene where it or another service stopped, and their file.

The design: fusion.md, "Several services". A restart neither loses nor doubles the movement in progress, nor forgets the
learned reliability of the observers.

The file has one JSON object per line. The first line is a whole checkpoint; each further line replaces those of its
parts that have changed. A last line that was cut off, as by a kill, is left out.
"""

import json
import logging
import os
from collections.abc import Iterable, Sequence
from collections.abc import Set as AbstractSet
from contextlib import suppress
from pathlib import Path
from typing import Any

from pydantic import AliasChoices, BaseModel, ConfigDict, Field, ValidationError

from common import SECOND_NS
from common.config import Scene
from common.files import open_private, read_text
from common.messages import JudgementMessage, VerdictMessage
from fusion.engine.trust import Reliability

log = logging.getLogger("labanmesh.fusion")
NOTHING_LEARNED = Reliability()
MEMORY_SUFFIX = ".memory.json"
FILE_LIMIT = 64 * 1024
"""Bytes; a file that is longer is replaced by one with the whole checkpoint."""
SELDOM_CHANGED = ("verdict", "reliability", "undelivered")
FORGET_S = 30.0
"""A movement that was in progress so long ago is over; how it ended is unknown."""


class Checkpoint(BaseModel):
    """The last judgement with the movement in progress, the last verdict, and the learned reliability.

    undelivered: ended verdicts that were sent while the link broke, so that listeners may not have received them.
    """

    model_config = ConfigDict(frozen=True)
    judgement: JudgementMessage
    verdict: VerdictMessage | None = None
    reliability: Reliability = Field(
        default=NOTHING_LEARNED, validation_alias=AliasChoices("lessons", "reliability"), serialization_alias="lessons"
    )
    """Called "lessons" in the file and in the answer to a handover request since their first version."""
    undelivered: tuple[VerdictMessage, ...] = ()
    people: tuple["Checkpoint", ...] = ()
    """Of the other people of a scene that judges several."""

    def age_s(self, now_ns: int) -> float:
        """Seconds between the last judgement and `now_ns`, however the clock was set."""
        return abs(now_ns - self.judgement.at_ns) / SECOND_NS

    @property
    def unfinished(self) -> VerdictMessage | None:
        """The verdict on the movement in progress, if it was decided."""
        return unfinished(self.judgement, self.verdict)

    @classmethod
    def of_people(cls, each: "Iterable[Checkpoint | None]") -> "Checkpoint | None":
        """Join the checkpoints of the people of a scene to one; None if there is none."""
        known = [checkpoint for checkpoint in each if checkpoint is not None]
        return known[0].model_copy(update={"people": tuple(known[1:])}) if known else None

    def to_json(self) -> str:
        """The text that `model_validate_json` reads."""
        return self.model_dump_json(by_alias=True)


def unfinished(judgement: JudgementMessage | None, verdict: VerdictMessage | None) -> VerdictMessage | None:
    """`verdict`, if its movement goes on in `judgement`."""
    movement = None if judgement is None else judgement.movement
    if verdict is None or movement is None or movement.id != verdict.id or verdict.ended_ns is not None:
        return None
    return verdict


class CheckpointFile:
    """The file `fusion.memory` of one scene; each fault is logged once, and the service continues without the file.

    siblings: the common beginning of the file names of all services of the scene, of which the newest is read: the
    service that wrote last was the owner last. "": there is one file.
    """

    def __init__(self, path: Path, own: str = "", siblings: str = "", suffix: str = MEMORY_SUFFIX) -> None:
        # Services on one machine may share a file that the scene file names; each then replaces it.
        self._path, self._temporary, self._siblings = path, path.with_name(f"{path.name}.{own}.new"), siblings
        self._suffix = suffix
        self._written: tuple[object, ...] = ()
        self._last: Checkpoint | None = None
        self._read_failed = self._write_failed = False

    @classmethod
    def of(cls, scene: Scene, own: str, person: str | None = None) -> "CheckpointFile | None":
        """The file of the service `own`; None if the scene file wants none, or the scene comes from no file.

        person: the one of several people whose movements it keeps. Where `fusion.memory` names nothing it is
        $STATE_DIRECTORY, which systemd sets, or the scene file's folder. In a folder each service has its own file.
        """
        memory, state = scene.fusion.memory, os.environ.get("STATE_DIRECTORY", "").partition(":")[0]
        if memory == "" or (memory is None and not scene.has_folder):
            return None
        place = scene.place(memory if memory is not None else state)
        of_person = f".{person}" if person else ""
        if memory is not None and not place.is_dir():
            return cls(place.with_name(place.name + of_person), own)
        suffix = MEMORY_SUFFIX + of_person
        return cls(place / f"{scene.scene}.{own}{suffix}", own, f"{scene.scene}.", suffix)

    def beside(self, suffix: str) -> Path:
        """The path of another file of the same service, in the same place."""
        return self._path.with_name(f"{self._path.name}.{suffix}")

    def read(self, scene: str) -> Checkpoint | None:
        """The newest checkpoint of `scene`, however old; None when there is no file, or not one of this scene."""
        checkpoints = [
            checkpoint
            for path in self._paths()
            if (checkpoint := self._read(path)) is not None and checkpoint.judgement.scene == scene
        ]
        return max(checkpoints, key=lambda checkpoint: checkpoint.judgement.at_ns, default=None)

    def _paths(self) -> list[Path]:
        if not self._siblings:
            return [self._path]
        # Many scenes may share the folder; this is quicker than a pattern.
        with suppress(OSError), os.scandir(self._path.parent) as entries:
            names = [entry.name for entry in entries]
            return [
                Path(self._path.parent, n) for n in names if n.startswith(self._siblings) and n.endswith(self._suffix)
            ]
        return []

    def _read(self, path: Path) -> Checkpoint | None:
        try:
            return Checkpoint.model_validate(_merged(read_text(path)))
        except FileNotFoundError:
            return None
        except (OSError, ValueError, TypeError, RecursionError, ValidationError) as error:
            if not self._read_failed:
                log.warning("fusion.memory = %s: cannot be used, starting afresh: %s", path, str(error)[:100])
            self._read_failed = True
            return None

    def is_due(self, judgement: JudgementMessage, undelivered: Sequence[VerdictMessage] = ()) -> bool:
        """Whether the movement has changed since the last checkpoint, or a second of it has passed, or other ends are
        undelivered."""
        return _written_state(judgement, undelivered) != self._written

    def write(self, checkpoint: Checkpoint) -> None:
        """Write if it is due.

        Not synced: that may take a second on an SD card, and judgements would wait. A loss of power costs the movement
        in progress and the learned reliability; a damaged file is reported and not used.
        """
        if not self.is_due(checkpoint.judgement, checkpoint.undelivered):
            return
        self._written = _written_state(checkpoint.judgement, checkpoint.undelivered)
        try:
            if not self._append(checkpoint):
                self._replace(checkpoint)
            self._last = checkpoint
        except OSError as error:
            self._last = None
            if not self._write_failed:
                reason = (error.strerror or str(error)).lower()
                log.warning(
                    "fusion.memory = %s: cannot be written: %s; choose another file or folder", self._path, reason
                )
            self._write_failed = True

    def _append(self, checkpoint: Checkpoint) -> bool:
        """Add a line with what has changed; False if the whole checkpoint has to be written.

        That is so at the first time, when the file is long enough, and where other services may write it, too.
        """
        last = self._last
        if last is None or not self._siblings:
            return False
        parts = {name for name in SELDOM_CHANGED if getattr(checkpoint, name) is getattr(last, name)}
        line = _line(checkpoint, without=parts)
        try:
            descriptor = os.open(self._path, os.O_WRONLY | os.O_APPEND)
        except OSError:
            return False
        try:
            return os.fstat(descriptor).st_size <= FILE_LIMIT and os.write(descriptor, line) == len(line)
        except OSError:
            return False
        finally:
            os.close(descriptor)

    def _replace(self, checkpoint: Checkpoint) -> None:
        """Replace the file by one with the whole checkpoint; raises OSError."""
        with os.fdopen(open_private(self._temporary), "wb") as file:
            file.write(_line(checkpoint))
        self._temporary.replace(self._path)


def checkpoint_files(scene: Scene, own: str) -> dict[str | None, CheckpointFile]:
    """The files of the service `own` by person; none if the scene file wants none, or the scene comes from no file."""
    files = {person: CheckpointFile.of(scene, own, person) for person in scene.people.judged}
    return {person: file for person, file in files.items() if file is not None}


def _written_state(judgement: JudgementMessage, undelivered: Sequence[VerdictMessage]) -> tuple[object, ...]:
    """A new checkpoint is due when this changes: the movement, the second of it, and the ends that are undelivered."""
    movement = judgement.movement
    return movement, 0 if movement is None else judgement.at_ns // SECOND_NS, *[verdict.id for verdict in undelivered]


def _line(checkpoint: Checkpoint, without: AbstractSet[str] = frozenset()) -> bytes:
    """One line of a file. without: the parts that have not changed.

    A restarted service needs the number, the time and the movement of the last judgement, not the votes.
    """
    judgement = checkpoint.judgement.model_copy(update={"votes": {}, "facets": None, "why": None})
    line = checkpoint.model_copy(update={"judgement": judgement})
    return line.model_dump_json(by_alias=True, exclude=set(without)).encode() + b"\n"


def _merged(text: str) -> dict[str, Any]:
    """The checkpoint in a file; raises ValueError or TypeError for another text."""
    fields: dict[str, Any] = {}
    # Not splitlines: a label may have other characters that end a line.
    for line in text.split("\n"):
        try:
            fields |= json.loads(line)
        except ValueError:
            break
    return fields or json.loads(text)
