"""How a process begins and ends: logging to stderr, SIGTERM and Ctrl-C as a clean stop."""

import json
import logging
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from types import FrameType
from typing import Literal

SUPERVISOR = "LABANMESH_SUPERVISOR"
SUPERVISOR_LOOK_S = 0.5


def log_to_stderr() -> None:
    """One line a record on stderr, level from LABANMESH_LOG (default info); the loggers are labanmesh.<room>.

    LABANMESH_LOG_FORMAT is `text` (the default) or `json`.
    """
    level = os.environ.get("LABANMESH_LOG", "info").upper()
    form = os.environ.get("LABANMESH_LOG_FORMAT", "text").lower()
    known = level in logging.getLevelNamesMapping()
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(formatter(form))
    logging.basicConfig(handlers=[handler], level=level if known else logging.INFO)
    if form not in FORMATS:
        logging.getLogger("labanmesh").warning("LABANMESH_LOG_FORMAT = %r: unknown format; using text", form)
    if not known:
        logging.getLogger("labanmesh").warning("LABANMESH_LOG = %r: unknown level; using info", level)


@contextmanager
def stop_on_signals() -> Iterator[threading.Event]:
    """An event that SIGTERM or Ctrl-C sets; after Ctrl-C leaving the context raises KeyboardInterrupt (status 130).

    A second signal of either kind acts at once, as it would have without us. Only for the main thread. A process that
    `labanmesh up` started (LABANMESH_SUPERVISOR is its number) stops also when that one is gone, killed perhaps.
    """
    stop, came = threading.Event(), []
    supervisor = os.environ.get(SUPERVISOR, "")
    if supervisor == str(os.getppid()):
        threading.Thread(target=_outlive, args=(int(supervisor), stop), daemon=True, name="supervisor").start()

    def on_signal(number: int, frame: FrameType | None) -> None:
        came.append(number)
        _restore(before)
        # Not stop.set() here: it takes the event's lock, which the main thread may hold while it is interrupted.
        threading.Thread(target=stop.set).start()

    before = {number: signal.signal(number, on_signal) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield stop
    finally:
        _restore(before)
    if signal.SIGINT in came:
        raise KeyboardInterrupt


def _outlive(supervisor: int, stop: threading.Event) -> None:
    while not stop.wait(SUPERVISOR_LOOK_S):
        if os.getppid() != supervisor:
            logging.getLogger("labanmesh").warning("the process that started this one is gone: ending")
            stop.set()


def _restore(handlers: dict[signal.Signals, "signal._HANDLER"]) -> None:
    for number, handler in handlers.items():
        signal.signal(number, handler)


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


def set_log_identity(scene: str, role: Literal["observer", "fusion", "hub"], process: str) -> None:
    """From now on each line of JSON of this process says who it is: its scene, and under its role its id."""
    for handler in logging.root.handlers:
        if isinstance(handler.formatter, JsonLines):
            handler.formatter.speaker = {"scene": scene, role: process}


def as_json_line(process: str, line: str) -> str:
    """A line of some process as a line of JSON: as it is if it is one, else as the words of that process."""
    try:
        if isinstance(json.loads(line), dict):
            return line
    except ValueError:
        pass
    return json.dumps({"process": process, "message": line}, ensure_ascii=False)
