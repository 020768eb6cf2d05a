"""Checkpoints: a fusion service continues a scene where it, or another service, stopped. And the file for them.

A restart neither loses nor doubles the movement in progress, nor forgets the learned reliability of the observers.
"""

import logging
import os
from contextlib import suppress
from pathlib import Path

from pydantic import AliasChoices, BaseModel, ConfigDict, Field, ValidationError

from common import SECOND_NS
from common.config import Scene
from common.files import read_text
from common.messages import JudgementMessage, VerdictMessage
from fusion.engine.reliability import Reliability

log = logging.getLogger("labanmesh.fusion")
NOTHING_LEARNED = Reliability()
SUFFIX = ".memory.json"
FORGET_S = 30.0
"""A movement that was in progress this long ago is over, and how it ended is unknown."""


class Checkpoint(BaseModel):
    """The last judgement with the movement in progress, the last verdict, and the learned reliability."""

    model_config = ConfigDict(frozen=True)
    judgement: JudgementMessage
    verdict: VerdictMessage | None = None
    reliability: Reliability = Field(
        default=NOTHING_LEARNED, validation_alias=AliasChoices("lessons", "reliability"), serialization_alias="lessons"
    )
    """Called "lessons" in the file and in the answer to a handover request since their first version."""

    def age_s(self, now_ns: int) -> float:
        """Seconds between the last judgement and `now_ns`, however the clock was set."""
        return abs(now_ns - self.judgement.at_ns) / SECOND_NS

    @property
    def unfinished(self) -> VerdictMessage | None:
        """The verdict on the movement in progress, if it was decided."""
        return unfinished(self.judgement, self.verdict)

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

    siblings: how the file names of all services of the scene begin, of which the newest is read: the service that
    wrote last was the owner last. "": there is one file.
    """

    def __init__(self, path: Path, own: str = "", siblings: str = "") -> None:
        # Services on one machine may share a file that the scene file names.
        self._path, self._temporary, self._siblings = path, path.with_name(f"{path.name}.{own}.new"), siblings
        self._written: object = None
        self._read_failed = self._write_failed = False

    @classmethod
    def of(cls, scene: Scene, own: str) -> "CheckpointFile | None":
        """The file of the service `own`; None if the scene file wants none, or the scene comes from no file.

        Where `fusion.memory` names nothing it is $STATE_DIRECTORY, which systemd sets, or the scene file's folder. In a
        folder each service has a file of its own.
        """
        memory, state = scene.fusion.memory, os.environ.get("STATE_DIRECTORY", "").partition(":")[0]
        if memory == "" or (memory is None and not scene.has_folder):
            return None
        place = scene.place(memory if memory is not None else state)
        if memory is not None and not place.is_dir():
            return cls(place, own)
        return cls(place / f"{scene.scene}.{own}{SUFFIX}", own, f"{scene.scene}.")

    def read(self, scene: str) -> Checkpoint | None:
        """The newest checkpoint of `scene`, however old; None when there is no file, or not one of this scene."""
        known = [checkpoint for path in self._paths() if (checkpoint := self._read(path)) is not None]
        return max(
            (one for one in known if one.judgement.scene == scene), key=lambda one: one.judgement.at_ns, default=None
        )

    def _paths(self) -> list[Path]:
        if not self._siblings:
            return [self._path]
        # Many scenes may share the folder; this is quicker than a pattern.
        with suppress(OSError), os.scandir(self._path.parent) as entries:
            names = [entry.name for entry in entries]
            return [Path(self._path.parent, n) for n in names if n.startswith(self._siblings) and n.endswith(SUFFIX)]
        return []

    def _read(self, path: Path) -> Checkpoint | None:
        try:
            return Checkpoint.model_validate_json(read_text(path))
        except FileNotFoundError:
            return None
        except (OSError, ValueError, ValidationError) as error:
            if not self._read_failed:
                log.warning("fusion.memory = %s: cannot be used, starting afresh: %s", path, str(error)[:100])
            self._read_failed = True
            return None

    def write(self, checkpoint: Checkpoint) -> None:
        """Write if the movement has changed since the last call, and once a second while it goes on."""
        movement = checkpoint.judgement.movement
        state = (movement, movement and checkpoint.judgement.at_ns // SECOND_NS)
        if state == self._written:
            return
        self._written = state
        try:
            # Not synced: that may take a second on an SD card, and judgements would wait. What a loss of power costs is
            # a movement in progress, and weights that are learned anew; a damaged file is reported and not used.
            self._temporary.write_text(checkpoint.to_json(), encoding="utf-8")
            self._temporary.replace(self._path)
        except OSError as error:
            if not self._write_failed:
                reason = (error.strerror or str(error)).lower()
                log.warning(
                    "fusion.memory = %s: cannot be written: %s; choose another file or folder", self._path, reason
                )
            self._write_failed = True
