"""What all tests share that start processes: the command line of a verb, waiting for a condition, and time limits."""

import os
import sys
import threading
import time
from contextlib import contextmanager, suppress
from pathlib import Path

SOON_S = 120.0
"""What needs a moment on a quiet machine gets this on one that is busy with other work."""


def labanmesh(*words):
    """The command line of one verb."""
    return [sys.executable, "-P", "-m", "labanmesh", *map(str, words)]


def until(condition, description="the condition holds", timeout_s=SOON_S):
    """Poll `condition()` until it is true; returns its value. description: text, or a function that returns one."""
    pause, end_s = threading.Event(), time.monotonic() + timeout_s
    while not (value := condition()):
        text = description() if callable(description) else description
        assert time.monotonic() < end_s, f"not within {timeout_s} s: {text}"
        pause.wait(0.02)
    return value


def waited_s(*pids):
    """How long the threads of this process and others have waited for a processor so far; 0 where nobody tells."""
    waited_ns = 0
    for file in (file for pid in (os.getpid(), *pids) for file in Path(f"/proc/{pid}/task").glob("*/schedstat")):
        # A thread may end while it is read.
        with suppress(FileNotFoundError, ProcessLookupError):
            waited_ns += int(file.read_text().split()[1])
    return waited_ns / 1e9


@contextmanager
def within(limit_s, *pids):
    """Asserts that the block takes at most `limit_s`. What this process and `pids` wait for a processor does not count:
    that is the time of a busy machine."""
    began_s, waited_before_s = time.monotonic(), waited_s(*pids)
    yield
    took_s = time.monotonic() - began_s
    waiting_s = waited_s(*pids) - waited_before_s
    assert took_s < limit_s + waiting_s, f"{took_s:.2f} s, of these {waiting_s:.2f} s without a processor"
