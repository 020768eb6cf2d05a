"""How a process begins and ends: logging to stderr, SIGTERM and Ctrl-C as a clean stop."""

import logging
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from common.logs import FORMATS, formatter

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
