"""Ctrl-C in a command: the process ends within a second, with status 130 and without a traceback.

1. While modules are imported nothing has to be cleaned up, and the process ends at once (labanmesh.py).
2. While a command runs, KeyboardInterrupt unwinds it. The exception may be lost in a callback, and cleaning up may take
   long: END_S later, or at a second Ctrl-C, the process ends in any case.
3. A service has a handler of its own while it runs, and stops cleanly (`common.lifecycle.stop_on_signals`).
"""

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

STATUS = 130
"""The exit status of a shell's command that Ctrl-C has ended: 128, and the number of the signal."""
END_S = 0.7
"""Seconds in which a command may clean up after Ctrl-C; the rest of the second is for a machine that is busy."""


def end_at_once(number: int, frame: FrameType | None) -> None:
    """End the process at once: the handler while there is nothing to clean up."""
    os._exit(STATUS)


@contextmanager
def interruptible() -> Iterator[None]:
    """Run a command in the main thread: Ctrl-C raises KeyboardInterrupt, whatever exception libraries make of that."""
    interrupted = threading.Event()

    def on_ctrl_c(number: int, frame: FrameType | None) -> None:
        interrupted.set()
        signal.signal(signal.SIGINT, end_at_once)
        # What else is interrupted, such as a library's callback, has nothing to say.
        sys.unraisablehook, threading.excepthook = _ignore, _ignore
        threading.Thread(target=_end_soon, daemon=True, name="ctrl-c").start()
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, on_ctrl_c)
    try:
        yield
    except BaseException:
        if interrupted.is_set():
            raise KeyboardInterrupt from None
        raise
    finally:
        signal.signal(signal.SIGINT, end_at_once if interrupted.is_set() else before)


def _end_soon() -> None:
    time.sleep(END_S)
    os._exit(STATUS)


def _ignore(_: object) -> None:
    """Print nothing about an exception."""
