"""The link to the mesh: the only file that knows Zenoh. Bytes in, bytes out; what they mean is not its business.

1. Callbacks only enqueue: a slow one would stall the whole session and hang its close.
2. To close a link whose cable was pulled would block one of Zenoh's receiving threads for 10 s, and with it everybody
   else's: so no socket lingers (lingering.py).
3. How a session is set is in zenoh_settings.py, why a secured one cannot be opened in tls.py.
"""

import contextlib
import json
import logging
import threading
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import zenoh

from common.config import MeshConfig
from common.errors import BadInput, LabanmeshError
from common.inbox import Arrival, Inbox, Presence
from common.lingering import keep_ending
from common.wire import SIZE_LIMIT
from common.zenoh_settings import ADMITTED, Role, reason, settings

__all__ = ["Arrival", "Inbox", "Link", "Presence", "Publisher", "Role"]

ENCODING = "application/msgpack"
ROUTER_PATIENCE_S = 5.0
"""How long a client looks for its router before it says so; a supervisor then starts it again."""
CLOSE_PATIENCE_S = 3.0
"""A session that cannot close (a callback of ours that never returns) is left to the end of the process."""
OVERSIZE = bytes(SIZE_LIMIT + 1)
"""Stands for whatever was longer."""
ADMISSION_S = 3.0
"""A router answers in a millisecond whom it admits, and does not answer others: so long it may be busy."""
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
        keep_ending()

    @classmethod
    def open(
        cls,
        mesh: MeshConfig,
        role: Role,
        *,
        listen: Sequence[str] | None = None,
        patience_s: float = ROUTER_PATIENCE_S,
        named: str = "",
    ) -> "Link":
        """A session for `role` in `mesh`; with `listen` it is itself where the others meet.

        named: the id of the observer or fusion service, which this machine's certificate must be for, if it has one.
        Raises LabanmeshError, one line with the way out: endpoint in use, unusable, or no router within `patience_s`.
        """
        if mesh.credentials:
            _require_credentials(mesh, role, named)
        chosen = settings(mesh, role, listen, patience_s)
        where = (listen or [mesh.endpoint])[0]
        try:
            session = _session(zenoh.Config(), chosen)
        except zenoh.ZError as error:
            raise LabanmeshError(_why(mesh, str(error), where)) from None
        log.debug("link open as %s, %s", chosen["mode"], where)
        link = cls(session, where, str(chosen["mode"]))
        if mesh.credentials and chosen["mode"] == "client" and not link.admitted(ADMISSION_S):
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
            raise BadInput(f"{where}: no configuration of a Zenoh router: {said}; see docs/security.md") from None

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

    def publisher(self, key: str) -> Publisher:
        """A way to say things under `key`."""
        return Publisher(self._session.declare_publisher(key, encoding=ENCODING))

    def inbox(self, *keys: str, limit: int = 4096) -> Inbox:
        """One inbox for all that is said under `keys`, which may hold wildcards; the oldest go past `limit`."""
        inbox = Inbox(limit)

        def enqueue(sample: zenoh.Sample) -> None:
            payload = sample.payload
            # What no message can be is not copied: a queue full of such would fill the memory.
            said = payload.to_bytes() if len(payload) <= SIZE_LIMIT else OVERSIZE
            inbox.drop_in(str(sample.key_expr), said)

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

    def answer(self, key: str, last: Callable[[], bytes | Sequence[bytes] | None]) -> None:
        """Answer queries for `key` with what `last` returns: a value, several, the newest last, or None: nothing yet.

        `last` must be quick.
        """

        def reply(query: zenoh.Query) -> None:
            with query:
                said = last()
                for payload in [said] if isinstance(said, bytes) else said or ():
                    query.reply(key, payload, encoding=ENCODING)

        self._kept.append(self._session.declare_queryable(key, reply, complete=True))

    def ask(self, key: str, timeout_s: float) -> dict[str, bytes]:
        """The last value under each key that matches `key`, which may hold wildcards; empty after `timeout_s`."""
        return dict(self.ask_each(key, timeout_s))

    def ask_each(self, key: str, timeout_s: float) -> list[tuple[str, bytes]]:
        """All that is answered for `key`, of one key the newest last: whoever answers first, and all who do with it.

        Asks again while nobody answers, for a link that was just opened; empty after `timeout_s`.
        """
        waited_s = 0.0
        while not (replies := self._ask_once(key, timeout_s)) and waited_s < timeout_s:
            if self._closed.wait(ASK_AGAIN_S):
                break
            waited_s += ASK_AGAIN_S
        return replies

    def request(self, key: str, answered: Callable[[str, bytes], None], timeout_s: float) -> None:
        """Ask without waiting: `answered` gets each key and its bytes, in a thread of the mesh; it must be quick."""

        def pass_on(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                answered(str(reply.ok.key_expr), reply.ok.payload.to_bytes())

        with contextlib.suppress(zenoh.ZError):  # closed: nobody will answer
            self._session.get(key, pass_on, target=zenoh.QueryTarget.ALL, timeout=timeout_s)

    def _ask_once(self, key: str, timeout_s: float) -> list[tuple[str, bytes]]:
        # Several answers of one key are a history, of which Zenoh would keep but one.
        each = zenoh.ConsolidationMode.NONE
        replies = self._session.get(key, target=zenoh.QueryTarget.ALL, consolidation=each, timeout=timeout_s)
        samples = [reply.ok for reply in replies if reply.ok is not None]
        return [(str(sample.key_expr), sample.payload.to_bytes()) for sample in samples]

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


def _session(config: zenoh.Config, values: Mapping[str, Any]) -> zenoh.Session:
    for key, value in values.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


# The modules about certificates are heavy and imported only where there are some, or to explain a failure.
def _require_credentials(mesh: MeshConfig, role: Role, named: str) -> None:
    from common.credentials import require

    require(Path(mesh.credentials), role, named, datetime.now(UTC))


def _not_admitted(mesh: MeshConfig) -> str:
    from common.credentials import not_admitted

    return str(not_admitted(Path(mesh.credentials), mesh.endpoint))


def _why(mesh: MeshConfig, fault: str, where: str) -> str:
    """Zenoh's fault in one line; TLS faults are all one to it, so the endpoint is looked at without it."""
    from common.tls import why_unusable

    finding = why_unusable(mesh, datetime.now(UTC)) if "Unable to connect" in fault else None
    return reason(fault, f"mesh.endpoint = {where!r}") if finding is None else str(finding)
