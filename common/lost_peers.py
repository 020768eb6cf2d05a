"""Finds peers again that a process has lost alone, as after a stall that ends between the leases of two links.

Gossip connects peers when one of them comes to the meeting point, and Zenoh makes only that link again which it is
configured to have, the one to the meeting point. So two peers that lose each other, and not the meeting point, hear
nothing of each other for as long as both run. A peer that misses another one, to which others are linked, therefore
ends its own link to the meeting point: Zenoh makes it again at once, and gossip connects both.
"""

import os
import socket
from collections.abc import Collection, Iterable
from contextlib import suppress

from common.open_links import DESCRIPTORS

LOOKS = 4
"""After so many looks in a row without it a peer is lost: by then the others have given up one that has ended."""


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


def end_connections(port: int) -> int:
    """End this process's TCP connections to that port; returns their number."""
    ended = 0
    for descriptor in _descriptors():
        # A duplicate, which can be closed; what is no socket, or not connected, raises.
        with suppress(OSError, ValueError), socket.socket(fileno=os.dup(descriptor)) as duplicate:
            if duplicate.family in (socket.AF_INET, socket.AF_INET6) and duplicate.getpeername()[1] == port:
                duplicate.shutdown(socket.SHUT_RDWR)
                ended += 1
    return ended


def _descriptors() -> Collection[int]:
    try:
        return [int(name) for name in os.listdir(DESCRIPTORS)]  # noqa: PTH208 - pathlib takes three times as long
    except OSError:
        return []
