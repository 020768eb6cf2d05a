"""Takes SO_LINGER off this process's TCP sockets: Zenoh's close of a dead link would hold up all links for 10 s.

It closes a link on a thread that reads from others too (zenoh #2718), and has no setting for it. Linux only, where a
process can look through its own descriptors; elsewhere it does nothing. Measured in docs/design/faults.md.
"""

import os
import socket
import struct
import threading
import time
from contextlib import suppress
from functools import cache
from pathlib import Path

LOOK_S = 0.5
"""A quarter of the lease: a link is known before it can be given up."""
OFF = struct.pack("ii", 0, 0)


def end_lingering() -> int:
    """Switch it off on all TCP sockets that this process has now; returns on how many it was on."""
    found = 0
    with suppress(OSError):
        for entry in Path("/proc/self/fd").iterdir():
            with suppress(OSError, ValueError):
                if str(entry.readlink()).startswith("socket:"):
                    found += _end_on(int(entry.name))
    return found


def _end_on(descriptor: int) -> bool:
    # A copy, so that ours may be closed: options are the socket's, not the descriptor's.
    with socket.socket(fileno=os.dup(descriptor)) as held:
        if held.type != socket.SOCK_STREAM or held.family not in (socket.AF_INET, socket.AF_INET6):
            return False
        if held.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8)[:4] == OFF[:4]:
            return False
        held.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, OFF)
        return True


@cache
def keep_ending() -> None:
    """From now on look every half second, in one thread for the whole process however often this is called."""
    threading.Thread(target=_repeat, daemon=True, name="lingering").start()


def _repeat() -> None:
    while True:
        end_lingering()
        time.sleep(LOOK_S)
