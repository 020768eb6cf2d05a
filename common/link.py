"""The link to the mesh: opening and closing a session; with branch.py the only files that know Zenoh.

1. Bytes in, bytes out, and what is declared: branch.py.
2. To close a link whose cable was pulled would block one of Zenoh's receiving threads for 10 s, and with it everybody
   else's: so no socket lingers (lingering.py).
3. How a session is set is in zenoh_settings.py, why a secured one cannot be opened in tls.py.
"""

import json
import logging
import os
import socket
import struct
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

import zenoh

from common.config import MeshConfig
from common.errors import BadInput, LabanmeshError
from common.inbox import Arrival, Inbox, Presence
from common.subsession import Publisher, SubSession
from common.zenoh_settings import ADMITTED, MeshRole, reason, settings

__all__ = ["Arrival", "Inbox", "Link", "MeshRole", "Presence", "Publisher"]

ROUTER_TIMEOUT_S = 5.0
"""How long a client looks for its router before it says so; a supervisor then starts it again."""
CLOSE_TIMEOUT_S = 3.0
"""A session that cannot close (a callback of ours that never returns) is left to the end of the process."""
ADMISSION_TIMEOUT_S = 3.0
"""A router answers in a millisecond whom it admits, and does not answer others: so long it may be busy."""

log = logging.getLogger("labanmesh.common")


class Link(SubSession):
    """One process's session on the mesh, a context manager; `close` ends all that was made with it."""

    def __init__(self, session: zenoh.Session, endpoint: str, whatami: str) -> None:
        super().__init__(session)
        self._endpoint = endpoint
        self._whatami = whatami
        self._closing = threading.Lock()
        keep_ending()

    @classmethod
    def open(
        cls,
        mesh: MeshConfig,
        role: MeshRole,
        *,
        listen: Sequence[str] | None = None,
        timeout_s: float = ROUTER_TIMEOUT_S,
        process_id: str = "",
        scene: str = "",
    ) -> "Link":
        """A session for `role` in `mesh`; with `listen` it is itself where the others meet.

        process_id, scene: the id of the observer or fusion service, and its scene; a certificate of this machine must
        be for them.
        Raises LabanmeshError, one line with the way out: endpoint in use, unusable, or no router within `timeout_s`.
        """
        if mesh.credentials:
            _require_credentials(mesh, role, process_id, scene)
        chosen = settings(mesh, role, listen, timeout_s)
        where = (listen or [mesh.endpoint])[0]
        try:
            session = _session(zenoh.Config(), chosen)
        except zenoh.ZError as error:
            raise LabanmeshError(_why(mesh, str(error), where)) from None
        log.debug("link open as %s, %s", chosen["mode"], where)
        link = cls(session, where, str(chosen["mode"]))
        if mesh.credentials and chosen["mode"] == "client" and not link.admitted(ADMISSION_TIMEOUT_S):
            link.close()
            raise LabanmeshError(_not_admitted(mesh))
        return link

    @classmethod
    def router(cls, text: str, where: str) -> "Link":
        """A router as the Zenoh configuration in `text` (JSON5) says; raises LabanmeshError that names `where` it is.

        Its admin space is switched on, read-only, whatever `text` says: it tells where the router listens.
        """
        cls.check_router(text, where)
        try:
            return cls(_session(zenoh.Config.from_json5(text), {"adminspace/enabled": True}), where, "router")
        except zenoh.ZError as error:
            raise LabanmeshError(reason(str(error), where)) from None

    @staticmethod
    def check_router(text: str, where: str) -> None:
        """Raises BadInput, one line that names `where` it is, when `text` is no Zenoh configuration in JSON5."""
        try:
            zenoh.Config.from_json5(text)
        except zenoh.ZError as error:
            said = " ".join(str(error).split(" at /")[0].split())[:200]
            raise BadInput(f"{where}: no Zenoh router configuration: {said}; see docs/design/security.md") from None

    def admitted(self, timeout_s: float) -> bool:
        """Whether a router under access rules answers this process: its certificate counts there."""
        return bool(self.ask(ADMITTED, timeout_s))

    @property
    def locator(self) -> str:
        """Where this link listens, with the port it really got; raises LabanmeshError for one that does not listen."""
        for reply in self._session.get(f"@/{self._session.zid()}/{self._whatami}", timeout=2.0):
            if reply.ok is not None:
                locators = json.loads(reply.ok.payload.to_string())["locators"]
                if locators:
                    return str(locators[0])
        raise LabanmeshError(f"mesh.endpoint = {self._endpoint!r}: this process does not listen, it is only a client")

    def close(self) -> None:
        """End the session and wake whoever waits on an inbox; a second call does nothing; never hangs."""
        with self._closing:
            if self._closed.is_set():
                return
            self._closed.set()
        for inbox in self._inboxes:
            inbox.wake()
        ending = threading.Thread(target=self._session.close, daemon=True, name="link-close")
        ending.start()
        ending.join(CLOSE_TIMEOUT_S)
        if ending.is_alive():
            log.warning("the Zenoh session did not close within %g s; it ends with the process", CLOSE_TIMEOUT_S)


def _session(config: zenoh.Config, values: Mapping[str, Any]) -> zenoh.Session:
    for key, value in values.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


# The modules about certificates are heavy and imported only where there are some, or to explain a failure.
def _require_credentials(mesh: MeshConfig, role: MeshRole, process_id: str, scene: str) -> None:
    from common.credentials import require_credentials

    require_credentials(Path(mesh.credentials), role, process_id, datetime.now(UTC), scene)


def _not_admitted(mesh: MeshConfig) -> str:
    from common.credentials import admission_fault

    return str(admission_fault(Path(mesh.credentials), mesh.endpoint))


def _why(mesh: MeshConfig, fault: str, where: str) -> str:
    """Zenoh's fault in one line; TLS faults are all one to it, so the endpoint is looked at without it."""
    from common.tls import endpoint_fault

    finding = endpoint_fault(mesh, datetime.now(UTC)) if "Unable to connect" in fault else None
    return reason(fault, f"mesh.endpoint = {where!r}") if finding is None else str(finding)


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
