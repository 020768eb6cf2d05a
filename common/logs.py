"""What a log line looks like: text for people, or a line of JSON for programs, with scene, process and verdict id.

The form is chosen by LABANMESH_LOG_FORMAT (`text` or `json`); `common/lifecycle.py:log_to_stderr` puts it to use.
"""

import json
import logging
from datetime import UTC, datetime
from typing import Literal

FORMATS = ("text", "json")
FIELDS = ("verdict", "label", "agree", "heard", "ended")
"""What a record may carry besides its words: log.info(..., extra={"verdict": ...}); left out where it is not said."""


class JsonLines(logging.Formatter):
    """A record as one line of JSON: at (UTC), level, logger, message, who speaks, and what else the record carries."""

    def __init__(self) -> None:
        super().__init__()
        self.speaker: dict[str, str] = {}

    def format(self, record: logging.LogRecord) -> str:
        """The line; whatever a stranger may have said in it, it stays one line."""
        said = {
            "at": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            **self.speaker,
            **{name: getattr(record, name) for name in FIELDS if hasattr(record, name)},
        }
        if record.exc_info:
            said["exception"] = self.formatException(record.exc_info)
        return json.dumps(said, ensure_ascii=False, default=str)


def formatter(kind: str) -> logging.Formatter:
    """The form of that kind; text for all others."""
    return (
        JsonLines()
        if kind == "json"
        else logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s", "%H:%M:%S")
    )


def speak_as(scene: str, role: Literal["observer", "fusion", "hub"], process: str) -> None:
    """From now on each line of JSON of this process says who it is: its scene, and under its role its id."""
    for handler in logging.root.handlers:
        if isinstance(handler.formatter, JsonLines):
            handler.formatter.speaker = {"scene": scene, role: process}


def wrapped(process: str, line: str) -> str:
    """A line of some process as a line of JSON: as it is if it is one, else as the words of that process."""
    try:
        if isinstance(json.loads(line), dict):
            return line
    except ValueError:
        pass
    return json.dumps({"process": process, "message": line}, ensure_ascii=False)
