"""Looks after the links to the mesh that this process has open.

1. Zenoh closes a dead link on a thread that also receives from others (zenoh #2718). With SO_LINGER, the close of a
   link whose cable was pulled would block them all for 10 s, and Zenoh has no setting for it. So SO_LINGER is switched
   off on this process's TCP sockets (Linux only, where a process can list its own descriptors).
2. Links that are still open when the program ends are closed before the interpreter is torn down: a thread that
   returns from Zenoh later would abort the process ("exception not rethrown"), and Zenoh's threads that wait for
   messages would keep it from ending.
"""

import os
import socket
import struct
import sys
import threading
import time
from contextlib import suppress
from functools import cache
from typing import Protocol
from weakref import WeakSet

CHECK_S = 0.5
"""A quarter of the lease, so that every socket is found before its link can be given up."""
DESCRIPTORS = "/proc/self/fd"
"""Where Linux lists a process's open files; elsewhere there is none."""
LINGER_OFF = struct.pack("ii", 0, 0)
CALLBACK_THREAD = "(pyo3-closure)"
"""Ends the name of each thread in which Zenoh calls a callback; it lives until its session is closed."""
CALLERS = ("common.link", "common.subsession")
"""The modules that call Zenoh."""
LAST_CALLS_S = 3.0
"""Calls return as soon as their session is closed, and their thread has its turn to run, on any machine by then."""


class Closable(Protocol):
    """What can be closed, also twice."""

    def close(self) -> None:
        """End it."""


_open: WeakSet[Closable] = WeakSet()


def attend(link: Closable) -> None:
    """Look after `link` until it is closed."""
    _open.add(link)
    _begin()


@cache
def _begin() -> None:
    """Start the thread that looks after all links, one per process."""
    # Not a daemon: the interpreter waits for it, and so for the end of the links.
    threading.Thread(target=_attend_all, daemon=False, name="links").start()


def _attend_all() -> None:
    """Switch lingering off twice a second until the program's own threads have ended; then close what is open."""
    while working := _working_threads():
        end_lingering()
        working[0].join(CHECK_S)
    for link in tuple(_open):
        link.close()
    until_s = time.monotonic() + LAST_CALLS_S
    while _is_zenoh_called() and time.monotonic() < until_s:
        time.sleep(sys.getswitchinterval())


def _working_threads() -> list[threading.Thread]:
    """The threads that keep this process from ending, the main thread first, but for this one and Zenoh's."""
    return [
        thread
        for thread in threading.enumerate()
        if not thread.daemon
        and thread.is_alive()
        and thread is not threading.current_thread()
        and not thread.name.endswith(CALLBACK_THREAD)
    ]


def _is_zenoh_called() -> bool:
    """Whether a daemon thread is within a call of Zenoh."""
    return any(frame.f_globals.get("__name__") in CALLERS for frame in sys._current_frames().values())


def end_lingering() -> int:
    """Switch SO_LINGER off on all TCP sockets that this process has now; returns the number of sockets changed.

    All are checked each time: Zenoh sets the option when a connection is made, maybe long after the socket was opened.
    """
    changed = 0
    with suppress(OSError):
        for name in os.listdir(DESCRIPTORS):  # noqa: PTH208 - pathlib takes three times as long
            with suppress(OSError, ValueError):
                if os.readlink(f"{DESCRIPTORS}/{name}").startswith("socket:"):  # noqa: PTH115
                    changed += _switch_off_linger(int(name))
    return changed


def _switch_off_linger(descriptor: int) -> bool:
    # A duplicate, which can be closed: options belong to the socket and not to the descriptor.
    with socket.socket(fileno=os.dup(descriptor)) as duplicate:
        if duplicate.type != socket.SOCK_STREAM or duplicate.family not in (socket.AF_INET, socket.AF_INET6):
            return False
        if duplicate.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8)[:4] == LINGER_OFF[:4]:
            return False
        duplicate.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER_OFF)
        return True
