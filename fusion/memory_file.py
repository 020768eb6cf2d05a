"""The file in which a fusion service keeps the movement that goes on and what it learned of its judges.

A restart neither loses nor doubles the movement, nor has to learn anew who can be relied on.
"""

import logging
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from common.messages import JudgementMessage, VerdictMessage
from fusion.engine.reliability import Reliability

log = logging.getLogger("labanmesh.fusion")
SECOND_NS = 1_000_000_000
NONE = Reliability()
FORGET_S = 30.0
"""A movement that went on so long ago is over: nobody knows how it ended."""


class Remembered(BaseModel):
    """The last judgement, with the movement that went on, the last verdict, and the lessons of all verdicts."""

    model_config = ConfigDict(frozen=True)
    judgement: JudgementMessage
    verdict: VerdictMessage | None = None
    lessons: Reliability = NONE


class Memory:
    """Written whenever a movement begins, is decided or ends; a file that cannot be written is told once."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._kept: object = None
        self._told = self._complained = False

    def recall(self, scene: str, now_ns: int) -> Remembered | None:
        """What was kept of `scene`, if that is not too old; None also for no file or one that is none of ours."""
        found = self._read(scene)
        fresh = found is not None and abs(now_ns - found.judgement.at_ns) <= FORGET_S * SECOND_NS
        return found if fresh else None

    def lessons(self, scene: str) -> Reliability:
        """What was learned of the judges of `scene`, however long ago."""
        found = self._read(scene)
        return NONE if found is None else found.lessons

    def _read(self, scene: str) -> Remembered | None:
        try:
            found = Remembered.model_validate_json(self._path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return None
        except (OSError, ValueError, ValidationError) as error:
            if not self._complained:
                log.warning("fusion.memory = %s: cannot be used, beginning afresh: %s", self._path, str(error)[:100])
            self._complained = True
            return None
        return found if found.judgement.scene == scene else None

    def keep(self, judgement: JudgementMessage, verdict: VerdictMessage | None, lessons: Reliability = NONE) -> None:
        """Write if something changed in the movement since the last call."""
        # While a movement goes on also once a second, so that it is known how old it is.
        state = (judgement.movement, judgement.movement and judgement.at_ns // SECOND_NS)
        if state == self._kept:
            return
        self._kept = state
        remembered = Remembered(judgement=judgement, verdict=verdict, lessons=lessons)
        beside = self._path.with_name(f"{self._path.name}.new")
        try:
            beside.write_text(remembered.model_dump_json(), encoding="utf-8")
            beside.replace(self._path)
        except OSError as error:
            if not self._told:
                log.warning("fusion.memory = %s: cannot be written: %s", self._path, error.strerror)
            self._told = True
