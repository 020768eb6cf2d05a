"""Checkpoints: a fusion service continues a scene where it, or another service, stopped. And the file for them.

A restart neither loses nor doubles the movement in progress, nor forgets the learned reliability of the observers.
"""

import logging
from pathlib import Path

from pydantic import AliasChoices, BaseModel, ConfigDict, Field, ValidationError

from common import SECOND_NS
from common.messages import JudgementMessage, VerdictMessage
from fusion.engine.reliability import Reliability

log = logging.getLogger("labanmesh.fusion")
NOTHING_LEARNED = Reliability()
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

    def to_json(self) -> str:
        """The text that `model_validate_json` reads."""
        return self.model_dump_json(by_alias=True)


class CheckpointFile:
    """The file `fusion.memory` of one scene; each fault is logged once, and the service continues without the file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._written: object = None
        self._read_failed = self._write_failed = False

    def read(self, scene: str) -> Checkpoint | None:
        """The checkpoint of `scene`, however old; None when there is no file, or not one of this scene."""
        try:
            checkpoint = Checkpoint.model_validate_json(self._path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return None
        except (OSError, ValueError, ValidationError) as error:
            if not self._read_failed:
                log.warning("fusion.memory = %s: cannot be used, starting afresh: %s", self._path, str(error)[:100])
            self._read_failed = True
            return None
        return checkpoint if checkpoint.judgement.scene == scene else None

    def write(self, checkpoint: Checkpoint) -> None:
        """Write if the movement has changed since the last call, and once a second while it goes on."""
        movement = checkpoint.judgement.movement
        state = (movement, movement and checkpoint.judgement.at_ns // SECOND_NS)
        if state == self._written:
            return
        self._written = state
        temporary = self._path.with_name(f"{self._path.name}.new")
        try:
            temporary.write_text(checkpoint.to_json(), encoding="utf-8")
            temporary.replace(self._path)
        except OSError as error:
            if not self._write_failed:
                reason = (error.strerror or str(error)).lower()
                log.warning("fusion.memory = %s: cannot be written: %s; choose another file", self._path, reason)
            self._write_failed = True
