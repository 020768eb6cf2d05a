"""Start and end of a process: log lines on stderr as text or JSON, SIGTERM and Ctrl-C as a clean stop."""

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
from typing import TYPE_CHECKING

from common.log_limit import LimitedHandler

if TYPE_CHECKING:
    from common.messages import ProcessRole

SUPERVISOR_VARIABLE = "LABANMESH_SUPERVISOR"
SUPERVISOR_CHECK_S = 0.5
LOG_FORMATS = ("text", "json")
LOG_FIELDS = ("verdict", "label", "agree", "heard", "ended", "stage", "revises", "why")
"""Optional fields of a JSON line: log.info(..., extra={"verdict": ...})."""


def log_to_stderr() -> None:
    """Log one line per record to stderr, none too often (log_limit.py); the loggers are labanmesh.<package>.

    LABANMESH_LOG is the level (default info), LABANMESH_LOG_FORMAT is `text` (default) or `json`.
    """
    level = os.environ.get("LABANMESH_LOG", "info").upper()
    log_format = os.environ.get("LABANMESH_LOG_FORMAT", "text").lower()
    level_known = level in logging.getLevelNamesMapping()
    handler = LimitedHandler(sys.stderr)
    handler.setFormatter(formatter(log_format))
    logging.basicConfig(handlers=[handler], level=level if level_known else logging.INFO)
    if log_format not in LOG_FORMATS:
        logging.getLogger("labanmesh").warning("LABANMESH_LOG_FORMAT = %r: unknown format; using text", log_format)
    if not level_known:
        logging.getLogger("labanmesh").warning("LABANMESH_LOG = %r: unknown level; using info", level)


@contextmanager
def stop_on_signals(for_s: float | None = None) -> Iterator[threading.Event]:
    """An event that SIGTERM or Ctrl-C sets; after Ctrl-C the end of the context raises KeyboardInterrupt (status 130).

    for_s: it is also set after so many seconds; None: it is not. A KeyboardInterrupt that only tells that the event is
    set, as the search for a router raises it, ends the command with status 0, unless it was Ctrl-C.
    A second signal acts at once, with its handler from before. Only for the main thread. A process that `labanmesh up`
    started (LABANMESH_SUPERVISOR is its process number) also stops when that process is gone, for example killed.
    """
    stop, received = threading.Event(), []
    supervisor = os.environ.get(SUPERVISOR_VARIABLE, "")
    if supervisor == str(os.getppid()):
        threading.Thread(target=_watch_supervisor, args=(int(supervisor), stop), daemon=True, name="supervisor").start()

    def on_signal(number: int, frame: FrameType | None) -> None:
        received.append(number)
        _restore(before)
        # In a thread, because stop.set() takes a lock that the interrupted main thread may hold.
        threading.Thread(target=stop.set).start()

    before = {number: signal.signal(number, on_signal) for number in (signal.SIGTERM, signal.SIGINT)}
    timer = threading.Timer(for_s or 0.0, stop.set)
    timer.daemon = True
    if for_s is not None:
        timer.start()
    try:
        yield stop
    except KeyboardInterrupt:
        if signal.SIGINT in received or not stop.is_set():
            raise
        import typer

        raise typer.Exit from None
    finally:
        timer.cancel()
        _restore(before)
    if signal.SIGINT in received:
        raise KeyboardInterrupt


def _watch_supervisor(supervisor: int, stop: threading.Event) -> None:
    while not stop.wait(SUPERVISOR_CHECK_S):
        if os.getppid() != supervisor:
            logging.getLogger("labanmesh").warning("the process that started this one is gone; ending")
            stop.set()


def _restore(handlers: dict[signal.Signals, "signal._HANDLER"]) -> None:
    for number, handler in handlers.items():
        signal.signal(number, handler)


class JsonLines(logging.Formatter):
    """A record as one line of JSON: at (UTC), level, logger, message, the process, and the record's optional fields."""

    def __init__(self) -> None:
        super().__init__()
        self.identity: dict[str, str] = {}

    def format(self, record: logging.LogRecord) -> str:
        """One line, whatever text the record has."""
        fields = {
            "at": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            **self.identity,
            **{name: getattr(record, name) for name in LOG_FIELDS if hasattr(record, name)},
        }
        if record.exc_info:
            fields["exception"] = self.formatException(record.exc_info)
        return json.dumps(fields, ensure_ascii=False, default=str)


def formatter(kind: str) -> logging.Formatter:
    """The formatter for `json`; for any other kind that for text."""
    if kind == "json":
        return JsonLines()
    return logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s", "%H:%M:%S")


def set_log_identity(scene: str, role: "ProcessRole", process: str) -> None:
    """Add the scene, and the process's id under its role, to every JSON line of this process from now on."""
    for handler in logging.root.handlers:
        if isinstance(handler.formatter, JsonLines):
            handler.formatter.identity = {"scene": scene, role: process}


def as_json_line(process: str, line: str) -> str:
    """A line of output of `process` as a line of JSON; a line that is a JSON object stays as it is."""
    try:
        if isinstance(json.loads(line), dict):
            return line
    except (ValueError, RecursionError):
        pass
    return json.dumps({"process": process, "message": line}, ensure_ascii=False)
