"""The connections of the page's browsers, accepted here so that strangers can use up neither descriptors nor memory.

1. A browser has REQUEST_S for each request; a connection on which nothing is asked is closed.
2. There are at most so many connections in all and from one address. Beyond that the one that has been idle for longest
   makes room for the new one; when none is idle the new one is closed.
3. An accept that fails, as without descriptors, is tried again after ACCEPT_BACK_OFF_S. asyncio's own loop tries it
   once for each place in the backlog, and logs each time.
"""

import asyncio
import logging
import resource
import socket
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

from uvicorn.protocols.http.h11_impl import H11Protocol

from common.errors import reason_of
from hub.dashboard.guesses import address_group

log = logging.getLogger("labanmesh.hub")
CONNECTIONS_LIMIT, ADDRESS_LIMIT = 1024, 400
"""Fifty browsers behind one address have six connections each."""
DESCRIPTORS_KEPT = 32
"""For files, and for the mesh when it reconnects."""
REQUEST_S = 10.0
ACCEPT_BACK_OFF_S = 0.5
CROWDED_S = 0.002
"""Pause after a connection that another one made room for: a flood of them takes a sixth of a core, not a third, and a
full backlog of 128 is accepted within a third of a second."""


@dataclass(slots=True)
class ConnectionTable:
    """All open connections by the address that they came from, in the order in which they were opened. Pure."""

    limit: int = CONNECTIONS_LIMIT
    address_limit: int = ADDRESS_LIMIT
    _open: dict["BrowserConnection", str] = field(default_factory=dict)
    _of: dict[str, dict["BrowserConnection", None]] = field(default_factory=lambda: defaultdict(dict))

    def __len__(self) -> int:
        return len(self._open)

    def make_room(self, address: str) -> bool:
        """Whether one more connection from `address` may be opened; ends an idle one for it if that is needed."""
        own = self._of.get(address, {})
        if len(own) >= self.address_limit:
            return self._end_idle(own)
        return len(self._open) < self.limit or self._end_idle(self._open)

    def add(self, connection: "BrowserConnection", address: str) -> None:
        """Take in a connection that was opened."""
        self._open[connection] = address
        self._of[address][connection] = None

    def remove(self, connection: "BrowserConnection") -> None:
        """Forget a connection that was closed."""
        address = self._open.pop(connection, None)
        if address is not None:
            del self._of[address][connection]
            if not self._of[address]:
                del self._of[address]

    def _end_idle(self, connections: "dict[BrowserConnection, None] | dict[BrowserConnection, str]") -> bool:
        oldest = next((each for each in connections if each.idle), None)
        if oldest is None:
            return False
        self.remove(oldest)
        oldest.end()
        return True


def table_for_this_process() -> ConnectionTable:
    """A table whose limits leave DESCRIPTORS_KEPT of this process's file descriptors free for its other work."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    limit = CONNECTIONS_LIMIT
    if soft != resource.RLIM_INFINITY:
        used = sum(1 for _ in Path("/dev/fd").iterdir())
        limit = max(1, min(limit, soft - used - DESCRIPTORS_KEPT))
    # So that one address does not keep all others out.
    return ConnectionTable(limit, max(1, min(ADDRESS_LIMIT, limit * 3 // 4)))


class BrowserConnection(H11Protocol):
    """One connection of a browser, for uvicorn: it is in `table`, and ends when no request comes for `request_s`."""

    table: ClassVar[ConnectionTable]
    request_s: ClassVar[float] = REQUEST_S
    _timer: asyncio.TimerHandle | None = None

    @property
    def idle(self) -> bool:
        """Whether no request is being answered."""
        return self.cycle is None or self.cycle.response_complete

    def end(self) -> None:
        """Close the connection at once."""
        self.transport.abort()

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Enter it into the table."""
        super().connection_made(transport)
        self.table.add(self, address_group(str((transport.get_extra_info("peername") or ("",))[0])))
        self._watch()

    def connection_lost(self, exc: Exception | None) -> None:
        """Take it out of the table."""
        self.table.remove(self)
        self._unwatch()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Take in a part of a request."""
        super().data_received(data)
        self._watch()

    def _watch(self) -> None:
        """Watch the time while the next request is not complete; uvicorn itself watches between two requests."""
        if not self.idle:
            self._unwatch()
        elif self._timer is None and not self.transport.is_closing():
            self._timer = self.loop.call_later(self.request_s, self.end)

    def _unwatch(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


def protocol_in(table: ConnectionTable) -> type[BrowserConnection]:
    """The protocol whose connections are in `table`; uvicorn makes its instances, so that each server has a class."""
    return type("TabledConnection", (BrowserConnection,), {"table": table})


async def accept_connections(
    port: socket.socket, table: ConnectionTable, protocol: Callable[[], asyncio.BaseProtocol]
) -> None:
    """Accept connections at the listening socket `port` until cancelled."""
    loop = asyncio.get_running_loop()
    port.setblocking(False)
    while True:
        try:
            connection, peer = await loop.sock_accept(port)
        except OSError as error:
            log.warning("cannot accept a browser: %s; trying again in %g s", reason_of(error), ACCEPT_BACK_OFF_S)
            await asyncio.sleep(ACCEPT_BACK_OFF_S)
            continue
        before = len(table)
        if table.make_room(address_group(str(peer[0]))):
            crowded = len(table) < before
            try:
                await loop.connect_accepted_socket(protocol, connection)
            except OSError:
                connection.close()
            if crowded:
                await asyncio.sleep(CROWDED_S)
        else:
            log.warning("too many connections: %d; one of %s was refused", len(table), peer[0])
            connection.close()
            # Without a pause a flood would keep everything else in this loop from its turn.
            await asyncio.sleep(0)
