"""The link to the mesh: opening and closing a Zenoh session. Only this file and subsession.py import Zenoh.

1. A link sends and receives bytes; subsession.py declares publishers, inboxes and queries.
2. open_links.py looks after the links of a process while they are open, and closes them when it ends.
3. zenoh_settings.py makes the settings of a session, tls.py finds out why a secured one cannot be opened.
"""

import json
import logging
import math
import re
import threading
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, wait
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import zenoh

from common.config import MeshConfig
from common.errors import BadInput, LabanmeshError
from common.open_links import LostPeers, attend, end_connections
from common.subsession import Publisher, SubSession
from common.zenoh_settings import ADMITTED, MeshRole, reason, settings

__all__ = ["Link", "MeshRole", "Publisher"]

ROUTER_TIMEOUT_S = 5.0
"""How long a client looks for its router before it fails; a supervisor then restarts it."""
CLOSE_TIMEOUT_S = 3.0
"""A session that cannot close (a callback of ours never returns) is left to the end of the process."""
NOTICE_AFTER_S, NOTICE_PROBE_S, OPENING_LOOK_S = 0.7, 0.5, 0.1
"""A client that still looks for its router says so after the first; it examines the endpoint for the second, and looks
for Ctrl-C that often."""
CONNECTION_CHECK_S, LOST_CHECKS = 0.5, 4
"""A process that has had no router for so many checks in a row says so; one that changes its rules is back sooner."""
ADMISSION_TIMEOUT_S = 3.0
"""A router answers an admitted client in a millisecond, and others never; this leaves time for a busy router."""

log = logging.getLogger("labanmesh.common")


class Link(SubSession):
    """One process's session on the mesh, a context manager; `close` ends everything declared with it."""

    def __init__(self, session: zenoh.Session, endpoint: str, whatami: str) -> None:
        super().__init__(session)
        self._endpoint = endpoint
        self._whatami = whatami
        self._closing = threading.Lock()
        attend(self)

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
        stop: threading.Event | None = None,
    ) -> "Link":
        """Open a session for `role` in `mesh`; with `listen` the others connect to this session.

        process_id, scene: the id of the observer or fusion service, and its scene; a certificate of this machine must
        be for them. stop: set by Ctrl-C, which ends the search for a router by KeyboardInterrupt.
        Raises LabanmeshError, one line with the way out: endpoint in use, unusable, or no router within `timeout_s`.
        """
        if mesh.credentials:
            _require_credentials(mesh, role, process_id, scene)
        values = settings(mesh, role, listen, timeout_s)
        endpoint, mode = (listen or [mesh.endpoint])[0], str(values["mode"])
        try:
            if mode == "client":
                session = _client_session(values, mesh, timeout_s, stop or threading.Event())
            else:
                session = _session(zenoh.Config(), values)
        except zenoh.ZError as error:
            raise LabanmeshError(_explain(mesh, str(error), endpoint)) from None
        log.debug("link open as %s, %s", mode, endpoint)
        link = cls(session, endpoint, mode)
        if mesh.credentials and mode == "client" and not link.admitted(ADMISSION_TIMEOUT_S):
            link.close()
            raise LabanmeshError(_explain_rejection(mesh))
        # Hubs show what they receive, and that nothing arrives.
        if mode == "client" and role != "hub":
            threading.Thread(target=link._report_connection, args=(mesh,), daemon=True, name="connection").start()
        # Observers hear of nobody but the fusion service: whoever listens to them finds them again.
        if mode == "peer" and role in ("hub", "standby") and not listen:
            threading.Thread(target=link._keep_peers, daemon=True, name="connection").start()
        return link

    @classmethod
    def router(cls, text: str, where: str) -> "Link":
        """Open a router with the Zenoh configuration in `text` (JSON5); raises LabanmeshError that names `where` it is.

        Its admin space is always switched on, read-only: it tells where the router listens.
        """
        cls.check_router(text, where)
        try:
            return cls(_session(zenoh.Config.from_json5(text), {"adminspace/enabled": True}), where, "router")
        except zenoh.ZError as error:
            raise LabanmeshError(reason(str(error), where)) from None

    @staticmethod
    def check_router(text: str, where: str) -> list[str]:
        """The endpoints where a router with the Zenoh configuration `text` (JSON5) listens.

        Raises BadInput, one line that names `where` it is, unless it is such a configuration.
        """
        try:
            endpoints = json.loads(zenoh.Config.from_json5(text).get_json("listen/endpoints"))
            return list(endpoints.get("router", ()) if isinstance(endpoints, dict) else endpoints)
        except zenoh.ZError as error:
            fault = " ".join(str(error).split(" at /")[0].split())[:200]
            raise BadInput(f"{where}: no Zenoh router configuration: {fault}; see docs/design/security.md") from None

    @property
    def connected(self) -> bool:
        """Whether this process is connected to a router or another peer now."""
        info = self._session.info
        return bool(info.routers_zid() or info.peers_zid())

    def _report_connection(self, mesh: MeshConfig) -> None:
        """Log when the router has gone, is back, or no longer admits this machine, until the link is closed."""
        missing, known = 0, self._session.info.routers_zid()
        while not self._closed.wait(CONNECTION_CHECK_S):
            with suppress(zenoh.ZError):  # closed meanwhile
                missing, before = 0 if self.connected else missing + 1, missing
                if missing == LOST_CHECKS:
                    log.warning("%s: no router answers any more; trying until one does", self._endpoint)
                elif before >= LOST_CHECKS and not missing:
                    log.warning("%s: a router answers again", self._endpoint)
                # A router takes up new rules by opening anew. One that refuses a certificate closes no connection.
                routers = self._session.info.routers_zid()
                if mesh.credentials and routers and routers != known:
                    known = routers
                    if not self.admitted(ADMISSION_TIMEOUT_S) and not self._closed.is_set():
                        log.warning("%s", _explain_rejection(mesh))

    def _keep_peers(self) -> None:
        """Find peers again that this process alone has lost, until the link is closed."""
        lost, port = LostPeers(), re.search(r":(\d+)(?:[?#]|$)", self._endpoint)
        while not self._closed.wait(CONNECTION_CHECK_S):
            # Closed meanwhile, or a peer of another make tells its state in other words.
            with suppress(zenoh.ZError, ValueError, LookupError, TypeError):
                missed = lost.note(map(str, self._session.info.peers_zid()))
                if port and missed and missed & self._linked_to_others():
                    log.info("%s: peers were lost; connecting again", self._endpoint)
                    end_connections(int(port[1]))

    def _linked_to_others(self) -> frozenset[str]:
        """The ids of the peers that this process's peers are linked to."""
        answers = [reply.ok for reply in self._session.get("@/*/peer", timeout=CONNECTION_CHECK_S)]
        states = [json.loads(answer.payload.to_string()) for answer in answers if answer is not None]
        return frozenset(str(session["peer"]) for state in states for session in state["sessions"])

    def admitted(self, timeout_s: float) -> bool:
        """Whether a router with access rules answers this process, because its certificate is in the rules."""
        return bool(self.ask(ADMITTED, timeout_s))

    @property
    def locator(self) -> str:
        """The endpoint on which this link listens, with its real port; raises LabanmeshError if it does not listen."""
        for reply in self._session.get(f"@/{self._session.zid()}/{self._whatami}", timeout=2.0):
            if reply.ok is not None:
                locators = json.loads(reply.ok.payload.to_string())["locators"]
                if locators:
                    return str(locators[0])
        raise LabanmeshError(f"mesh.endpoint = {self._endpoint!r}: this process does not listen; it is only a client")

    def close(self) -> None:
        """End the session and wake the threads that wait on an inbox. A second call does nothing. Never blocks."""
        with self._closing:
            if self._closed.is_set():
                return
            self._closed.set()
        for inbox in self._inboxes:
            inbox.wake()
        ending = threading.Thread(target=self._session.close, daemon=True, name="link-close")
        try:
            ending.start()
        except RuntimeError:  # at the interpreter's end no thread can begin
            ending.run()
            return
        ending.join(CLOSE_TIMEOUT_S)
        if ending.is_alive():
            log.warning("the Zenoh session did not close within %g s; it ends with the process", CLOSE_TIMEOUT_S)


def _session(config: zenoh.Config, values: Mapping[str, Any]) -> zenoh.Session:
    for key, value in values.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def _client_session(
    values: Mapping[str, Any], mesh: MeshConfig, timeout_s: float, stop: threading.Event
) -> zenoh.Session:
    """A client's session, opened in a thread, because Zenoh blocks until the router answers or `timeout_s` is over.

    Says once what it waits for; raises ZError, and KeyboardInterrupt as soon as `stop` is set.
    """
    opening: Future[zenoh.Session] = Future()

    def open_session() -> None:
        try:
            opening.set_result(_session(zenoh.Config(), values))
        except BaseException as error:  # noqa: BLE001 - raised where it is waited for
            opening.set_exception(error)

    threading.Thread(target=open_session, daemon=True, name="link-open").start()
    notice_s = time.monotonic() + NOTICE_AFTER_S
    while not opening.done():
        wait([opening], OPENING_LOOK_S)
        if stop.is_set():
            raise KeyboardInterrupt
        if time.monotonic() > notice_s:
            notice_s = math.inf
            _tell_of_search(mesh, timeout_s)
    return opening.result()


def _tell_of_search(mesh: MeshConfig, timeout_s: float) -> None:
    """One line on what keeps this machine from its router; nothing if the router is only slow."""
    from common.tls import endpoint_fault

    fault = endpoint_fault(mesh, datetime.now(UTC), NOTICE_PROBE_S)
    if fault is not None:
        log.warning("%s; trying for %g s", fault, timeout_s)


# The modules about certificates are slow to import, and needed only with certificates or to explain a failure.
def _require_credentials(mesh: MeshConfig, role: MeshRole, process_id: str, scene: str) -> None:
    from common.credentials import require_credentials

    require_credentials(Path(mesh.credentials), role, process_id, datetime.now(UTC), scene)


def _explain_rejection(mesh: MeshConfig) -> str:
    from common.credentials import admission_fault

    return str(admission_fault(Path(mesh.credentials), mesh.endpoint))


def _explain(mesh: MeshConfig, message: str, endpoint: str) -> str:
    """Zenoh's error message in one line. Its message is the same for all TLS failures, so the endpoint is probed."""
    from common.tls import endpoint_fault

    fault = endpoint_fault(mesh, datetime.now(UTC)) if "Unable to connect" in message else None
    return reason(message, f"mesh.endpoint = {endpoint!r}") if fault is None else str(fault)
