"""What all tests share that start processes: the command line of a verb, and waiting for a condition."""

import sys
import threading
import time

SOON_S = 20.0


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
