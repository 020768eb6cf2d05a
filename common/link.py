"""The link to the mesh: the only file that knows Zenoh. Bytes in, bytes out; what they mean is not its business.

1. Listening addresses and multicast are always set: Zenoh's own defaults are every interface, and on.
2. Callbacks only enqueue: a slow one would stall the whole session and hang its close.
3. On one machine all are peers, the fusion process is where they meet, and gossip connects each to each. Over a
   router all are clients, because peers would go round its access rules.
4. Who connects tries for ever, so that the order of starting does not matter; only a router's clients give up, since
   Zenoh opens no client without its router.
"""

import json
import logging
import threading
from collections.abc import Callable, Mapping, Sequence
from types import TracebackType
from typing import Any, Literal, Self

import zenoh

from common.config import MeshConfig
from common.errors import LabanmeshError
from common.inbox import Arrival, Inbox, Presence

__all__ = ["Arrival", "Inbox", "Link", "Presence", "Publisher", "Role"]

Role = Literal["fusion", "observer", "hub", "router"]
ENCODING = "application/msgpack"
LOOPBACK = "tcp/127.0.0.1:0"
RETRY = {"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 2}
"""Fast retry: a router or peer that comes back is found again in 0.1 s instead of Zenoh's 2 s."""
LEASE_MS = 2000
"""A process that went silent without closing (stopped, cable pulled) is gone for the others after this long."""
ROUTER_PATIENCE_S = 5.0
"""How long a client looks for its router before it says so; a supervisor then starts it again."""
CLOSE_PATIENCE_S = 3.0
"""A session that cannot close (a callback of ours that never returns) is left to the end of the process."""
ASK_AGAIN_S = 0.05
"""Pause between two asks while nobody answers: declarations of a peer just met may still be on their way."""

log = logging.getLogger("labanmesh.common")


class Publisher:
    """Says bytes under one key. Made by `Link.publisher`; safe to use from several threads."""

    def __init__(self, publisher: zenoh.Publisher) -> None:
        self._publisher = publisher

    def put(self, payload: bytes) -> None:
        """Send to all who listen now, if any; raises LabanmeshError when the link was closed."""
        try:
            self._publisher.put(payload)
        except zenoh.ZError as error:
            raise LabanmeshError(f"the link to the mesh is closed: {error}") from None

    def wait_for_subscriber(self, timeout_s: float) -> bool:
        """Whether somebody listens, within `timeout_s`."""
        matched = threading.Event()
        with self._publisher.declare_matching_listener(lambda status: matched.set() if status.matching else None):
            # The stub of eclipse-zenoh 1.10 says bool; it is an object.
            now: Any = self._publisher.matching_status
            return bool(now.matching) or matched.wait(timeout_s)


class Link:
    """One process's session on the mesh, a context manager; `close` ends all that was made with it."""

    def __init__(self, session: zenoh.Session, endpoint: str, whatami: str) -> None:
        self._session = session
        self._endpoint = endpoint
        self._whatami = whatami
        self._kept: list[object] = []
        self._inboxes: list[Inbox] = []
        self._closed = threading.Event()
        self._closing = threading.Lock()

    @classmethod
    def open(
        cls,
        mesh: MeshConfig,
        role: Role,
        *,
        listen: Sequence[str] | None = None,
        patience_s: float = ROUTER_PATIENCE_S,
    ) -> "Link":
        """A session for `role` in `mesh`; with `listen` it is itself where the others meet.

        Raises LabanmeshError, one line with the way out: endpoint in use, unusable, or no router within `patience_s`.
        """
        settings = _settings(mesh, role, listen, patience_s)
        where = (listen or [mesh.endpoint])[0]
        config = zenoh.Config()
        try:
            for key, value in settings.items():
                config.insert_json5(key, json.dumps(value))
            session = zenoh.open(config)
        except zenoh.ZError as error:
            raise LabanmeshError(_reason(str(error), where)) from None
        log.debug("link open as %s, %s", settings["mode"], where)
        return cls(session, where, str(settings["mode"]))

    @property
    def locator(self) -> str:
        """Where this link listens, with the port it really got; raises LabanmeshError for one that does not listen."""
        for reply in self._session.get(f"@/{self._session.zid()}/{self._whatami}", timeout=2.0):
            if reply.ok is not None:
                locators = json.loads(reply.ok.payload.to_string())["locators"]
                if locators:
                    return str(locators[0])
        raise LabanmeshError(f"mesh.endpoint = {self._endpoint!r}: this process does not listen, it is only a client")

    def publisher(self, key: str) -> Publisher:
        """A way to say things under `key`."""
        return Publisher(self._session.declare_publisher(key, encoding=ENCODING))

    def inbox(self, *keys: str, limit: int = 4096) -> Inbox:
        """One inbox for all that is said under `keys`, which may hold wildcards; the oldest go past `limit`."""
        inbox = Inbox(limit)

        def enqueue(sample: zenoh.Sample) -> None:
            inbox.drop_in(str(sample.key_expr), sample.payload.to_bytes())

        self._kept += [self._session.declare_subscriber(key, enqueue) for key in keys]
        self._inboxes.append(inbox)
        return inbox

    def announce(self, key: str) -> None:
        """Be seen as alive under `key` until the link closes or the process dies."""
        self._kept.append(self._session.liveliness().declare_token(key))

    def presence(self, key_expression: str) -> Presence:
        """Who is alive under `key_expression`, those who were before included."""
        presence = Presence()

        def note(sample: zenoh.Sample) -> None:
            presence.note(str(sample.key_expr), alive=sample.kind == zenoh.SampleKind.PUT)

        self._kept.append(self._session.liveliness().declare_subscriber(key_expression, note, history=True))
        return presence

    def answer(self, key: str, last: Callable[[], bytes | None]) -> None:
        """Answer queries for `key` with what `last` returns; None: nothing to say yet. `last` must be quick."""

        def reply(query: zenoh.Query) -> None:
            with query:
                payload = last()
                if payload is not None:
                    query.reply(key, payload, encoding=ENCODING)

        self._kept.append(self._session.declare_queryable(key, reply, complete=True))

    def ask(self, key: str, timeout_s: float) -> dict[str, bytes]:
        """The last values under `key`, which may hold wildcards: whoever answers first, and all who answer with it.

        Asks again while nobody answers, for a link that was just opened; empty after `timeout_s`.
        """
        waited_s = 0.0
        while not (replies := self._ask_once(key, timeout_s)) and waited_s < timeout_s:
            if self._closed.wait(ASK_AGAIN_S):
                break
            waited_s += ASK_AGAIN_S
        return replies

    def _ask_once(self, key: str, timeout_s: float) -> dict[str, bytes]:
        replies = self._session.get(key, target=zenoh.QueryTarget.ALL, timeout=timeout_s)
        samples = [reply.ok for reply in replies if reply.ok is not None]
        return {str(sample.key_expr): sample.payload.to_bytes() for sample in samples}

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
        ending.join(CLOSE_PATIENCE_S)
        if ending.is_alive():
            log.warning("the Zenoh session did not close within %g s; it ends with the process", CLOSE_PATIENCE_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _settings(mesh: MeshConfig, role: Role, listen: Sequence[str] | None, patience_s: float) -> Mapping[str, Any]:
    """Zenoh's settings for one process (rules 1 and 3 above)."""
    common = {
        "scouting/multicast/enabled": False,
        "scouting/delay": 0,
        "transport/link/tx/lease": LEASE_MS,
        # Tells where a session listens that asked for any free port; readable on the mesh, never writable.
        "adminspace/enabled": True,
    }
    meeting_point = listen is not None or role == "router" or (role == "fusion" and mesh.mode != "router")
    if meeting_point:
        mode = "router" if role == "router" else "peer"
        return {**common, "mode": mode, "listen/endpoints": list(listen or [mesh.endpoint]), "connect/endpoints": []}
    connect = {"connect/endpoints": [mesh.endpoint], "connect/retry": RETRY}
    if mesh.mode == "router":
        patience = {"connect/timeout_ms": round(patience_s * 1000), "connect/exit_on_failure": True}
        return {**common, **connect, **patience, "mode": "client", "listen/endpoints": []}
    patience = {"connect/timeout_ms": -1, "connect/exit_on_failure": False}
    return {**common, **connect, **patience, "mode": "peer", "listen/endpoints": [LOOPBACK]}


def _reason(fault: str, endpoint: str) -> str:
    """Zenoh's fault in one line that says what to do."""
    named = f"mesh.endpoint = {endpoint!r}"
    if "in use" in fault:
        return f"{named}: already in use; stop what listens there or choose another port in the scene file"
    if "Unable to connect" in fault:
        return f"{named}: no router answers there; start it with `labanmesh router` or correct the address"
    short = " ".join(fault.split(" at /")[0].split())[:200]
    return f"{named}: cannot be used: {short}; an endpoint is PROTOCOL/HOST:PORT, e.g. tcp/127.0.0.1:7447"
