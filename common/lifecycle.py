"""How a process begins and ends: logging to stderr, SIGTERM and Ctrl-C as a clean stop."""

import logging
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


def log_to_stderr() -> None:
    """One line a record on stderr, level from LABANMESH_LOG (default info); the loggers are labanmesh.<room>."""
    level = os.environ.get("LABANMESH_LOG", "info").upper()
    known = level in logging.getLevelNamesMapping()
    logging.basicConfig(
        stream=sys.stderr,
        level=level if known else logging.INFO,
        format="%(asctime)s %(levelname)s %(name)s: %(message)s",
        datefmt="%H:%M:%S",
    )
    if not known:
        logging.getLogger("labanmesh").warning("LABANMESH_LOG = %r: unknown level; using info", level)


@contextmanager
def stop_on_signals() -> Iterator[threading.Event]:
    """An event that SIGTERM or Ctrl-C sets; after Ctrl-C leaving the context raises KeyboardInterrupt (status 130).

    A second signal of either kind acts at once, as it would have without us. Only for the main thread.
    """
    stop, came = threading.Event(), []

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


def _restore(handlers: dict[signal.Signals, "signal._HANDLER"]) -> None:
    for number, handler in handlers.items():
        signal.signal(number, handler)
