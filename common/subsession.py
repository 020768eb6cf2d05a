"""What is declared on the mesh: publishers, inboxes, tokens, answers; what they mean is not its business.

1. Callbacks only enqueue: a slow one would stall the whole session and hang its close.
2. Zenoh gives each callback a thread of its own. A branch that is polled has none: all that comes waits in rings, which
   lose the oldest, until the loop asks for it. So a process of a thousand declarations stays one of a few threads.
"""

import contextlib
import threading
from collections.abc import Callable, Sequence
from functools import partial
from types import TracebackType
from typing import Any, Protocol, Self

import zenoh

from common.errors import LabanmeshError
from common.inbox import Inbox, Presence
from common.wire import SIZE_LIMIT

ENCODING = "application/msgpack"
OVERSIZE = bytes(SIZE_LIMIT + 1)
"""Stands for whatever was longer."""
ASK_AGAIN_S = 0.05
"""Pause between two asks while nobody answers: declarations of a peer just met may still be on their way."""
RING = 256
"""So many samples or queries wait in each ring of a polled branch."""


class _Ring(Protocol):
    def try_recv(self) -> object:
        """The oldest that waits; None when nothing does; raises ZError when nothing will come any more."""


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


class SubSession:
    """A part of a session on the mesh that can be given up alone; `close` ends all that was made with it.

    polled: nothing is called or put into an inbox but by `poll`.
    """

    def __init__(self, session: zenoh.Session, *, polled: bool = False) -> None:
        self._session, self._polled = session, polled
        self._kept: list[Any] = []
        self._inboxes: list[Inbox] = []
        self._rings: list[tuple[Any, Callable[[Any], None]]] = []
        self._awaited: list[tuple[Any, Callable[[Any], None], Callable[[], None]]] = []
        self._closed = threading.Event()

    def sub_session(self, *, polled: bool = False) -> "SubSession":
        """A part of its own on the same session, which outlives it."""
        return SubSession(self._session, polled=polled)

    def poll(self) -> None:
        """Take in all that waits in the rings of a polled branch; everything it calls is called here."""
        for ring, take_in in self._rings:
            _empty(ring, take_in)
        for awaited in tuple(self._awaited):
            replies, take_in, finished = awaited
            try:
                _empty(replies, take_in)
            except zenoh.ZError:  # all have answered, or the time is over
                self._awaited.remove(awaited)
                finished()

    def publisher(self, key: str) -> Publisher:
        """A way to say things under `key`."""
        made = self._session.declare_publisher(key, encoding=ENCODING)
        self._kept.append(made)
        return Publisher(made)

    def inbox(self, *keys: str, limit: int = 4096, ring: int = RING, remote: bool = False) -> Inbox:
        """Return one inbox for all messages under `keys`, which may hold wildcards; past `limit` the oldest are lost.

        ring: on a polled sub-session, how many messages of each key wait from one poll to the next; the oldest are
        lost. remote: leave out what this process publishes itself.
        """
        inbox = Inbox(limit)
        origin = zenoh.Locality.REMOTE if remote else None

        def enqueue(sample: zenoh.Sample) -> None:
            payload = sample.payload
            # What no message can be is not copied: a queue full of such would fill the memory.
            said = payload.to_bytes() if len(payload) <= SIZE_LIMIT else OVERSIZE
            inbox.put(str(sample.key_expr), said)

        for key in keys:
            declare = self._session.declare_subscriber
            self._declare(partial(declare, key, allowed_origin=origin), enqueue, ring)
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

        declare = self._session.liveliness().declare_subscriber
        self._declare(partial(declare, key_expression, history=True), note)
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

        self._declare(partial(self._session.declare_queryable, key, complete=True), reply)

    def answer_requests(self, key: str, respond: Callable[[bytes], bytes | None]) -> None:
        """Answer requests that name exactly `key` with what `respond` makes of their payload; None: no answer.

        A query with wildcards, as a listener sends for the last values, is not answered and changes nothing.
        """

        def reply(query: zenoh.Query) -> None:
            with query:
                if str(query.key_expr) != key or query.payload is None:
                    return
                response = respond(query.payload.to_bytes())
                if response is not None:
                    query.reply(key, response, encoding=ENCODING)

        self._declare(partial(self._session.declare_queryable, key, complete=True), reply)

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

    def request(
        self,
        key: str,
        answered: Callable[[str, bytes], None],
        timeout_s: float,
        finished: Callable[[], None] = lambda: None,
        payload: bytes | None = None,
    ) -> None:
        """Ask without waiting: `answered` gets each key and its bytes, in a thread of the mesh; it must be quick.

        finished: called once, when no more answers will come. payload: what the request carries.
        """

        def pass_on(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                answered(str(reply.ok.key_expr), reply.ok.payload.to_bytes())

        # No ring: what it holds is lost at the end of the answers. Nobody answers so often that this would fill.
        handler: Any = zenoh.handlers.FifoChannel(RING) if self._polled else zenoh.handlers.Callback(pass_on, finished)
        with contextlib.suppress(zenoh.ZError):  # closed: nobody will answer
            replies = self._session.get(key, handler, target=zenoh.QueryTarget.ALL, timeout=timeout_s, payload=payload)
            if self._polled:
                self._awaited.append((replies, pass_on, finished))

    def _ask_once(self, key: str, timeout_s: float) -> list[tuple[str, bytes]]:
        # Several answers of one key are a history, of which Zenoh would keep but one.
        each = zenoh.ConsolidationMode.NONE
        replies = self._session.get(key, target=zenoh.QueryTarget.ALL, consolidation=each, timeout=timeout_s)
        samples = [reply.ok for reply in replies if reply.ok is not None]
        return [(str(sample.key_expr), sample.payload.to_bytes()) for sample in samples]

    def close(self) -> None:
        """Give up all that was made with it and wake whoever waits on an inbox; a second call does nothing."""
        self._closed.set()
        kept, self._kept, self._rings = self._kept, [], []
        for made in kept:
            with contextlib.suppress(zenoh.ZError):  # the session was closed before
                made.undeclare()
        for inbox in self._inboxes:
            inbox.wake()

    def _declare(self, declare: Callable[[Any], Any], take_in: Callable[[Any], None], ring: int = RING) -> None:
        """Something for which `take_in` is called with what comes."""
        made = declare(zenoh.handlers.RingChannel(ring) if self._polled else take_in)
        self._kept.append(made)
        if self._polled:
            self._rings.append((made, take_in))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _empty(ring: _Ring, take_in: Callable[[Any], None]) -> None:
    # What comes meanwhile stays for the next time: a flood must not hold the loop.
    for _ in range(RING):
        if (came := ring.try_recv()) is None:
            return
        take_in(came)
