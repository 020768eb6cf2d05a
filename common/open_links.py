"""Looks after the links to the mesh that this process has open.

1. Zenoh closes a dead link on a thread that also receives from others (zenoh #2718). With SO_LINGER, the close of a
   link whose cable was pulled would block them all for 10 s, and Zenoh has no setting for it. So SO_LINGER is switched
   off on this process's TCP sockets (Linux only, where a process can list its own descriptors).
2. Links that are still open when the program ends are closed before the interpreter is torn down: a thread that
   returns from Zenoh later would abort the process ("exception not rethrown"), and Zenoh's threads that wait for
   messages would keep it from ending.
3. Gossip connects peers when one of them comes to the meeting point, and Zenoh makes only that link again which it is
   configured to have, the one to the meeting point. So two peers that lose each other, and not the meeting point, as
   after a stall that ends between the leases of two links, would hear nothing of each other any more. A peer that
   misses another one, to which others are linked, therefore ends its own link to the meeting point: Zenoh makes it
   again at once, and gossip connects both.
"""

import os
import socket
import struct
import sys
import threading
import time
from collections.abc import Iterable, Iterator
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
LOOKS = 4
"""After so many looks in a row without it a peer is lost: by then the others have given up one that has ended."""


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
    for connection in _tcp_sockets():
        with suppress(OSError):
            if connection.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8)[:4] != LINGER_OFF[:4]:
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER_OFF)
                changed += 1
    return changed


def end_connections(port: int) -> int:
    """End this process's TCP connections to that port; returns their number."""
    ended = 0
    for connection in _tcp_sockets():
        with suppress(OSError):  # not connected
            if connection.getpeername()[1] == port:
                connection.shutdown(socket.SHUT_RDWR)
                ended += 1
    return ended


def _tcp_sockets() -> Iterator[socket.socket]:
    """The TCP sockets of this process, each as a duplicate that is closed after its turn; both share all options."""
    try:
        names = os.listdir(DESCRIPTORS)  # noqa: PTH208 - pathlib takes three times as long
    except OSError:
        return
    for name in names:
        with suppress(OSError, ValueError):
            if not os.readlink(f"{DESCRIPTORS}/{name}").startswith("socket:"):  # noqa: PTH115
                continue
            with socket.socket(fileno=os.dup(int(name))) as duplicate:
                if duplicate.type == socket.SOCK_STREAM and duplicate.family in (socket.AF_INET, socket.AF_INET6):
                    yield duplicate


class LostPeers:
    """Which peers this process has been linked to and is not any more. Pure."""

    def __init__(self) -> None:
        self._linked: frozenset[str] = frozenset()
        self._missed: dict[str, int] = {}

    def note(self, linked: Iterable[str]) -> frozenset[str]:
        """Take in one look; returns those that have been missed for LOOKS looks, each once."""
        now = frozenset(linked)
        self._missed |= dict.fromkeys(self._linked - now, 0)
        self._missed = {peer: looks + 1 for peer, looks in self._missed.items() if peer not in now and looks < LOOKS}
        self._linked = now
        return frozenset(peer for peer, looks in self._missed.items() if looks == LOOKS)
