"""Declarations on the mesh: publishers, inboxes, liveliness tokens, queries and answers.

1. Callbacks only enqueue: a slow one would stall the whole session and block its close.
2. Zenoh gives each callback a thread of its own. A polled sub-session has none: everything that arrives waits in rings,
   which drop the oldest, until the loop polls. So a process with a thousand declarations has only a few threads.
"""

import contextlib
import threading
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal, Self

import zenoh

from common.errors import LabanmeshError
from common.inbox import BYTES_LIMIT, Inbox, NewestMessages, Presence
from common.wire import SIZE_LIMIT

ENCODING = "application/msgpack"
OVERSIZE = bytes(SIZE_LIMIT + 1)
"""Replaces a payload that is too large for any message."""
RETRY_S = 0.05
"""Pause between two queries while nobody answers: declarations of a new peer may still be on their way."""
ANSWERS_BYTES = 16 << 20
"""Of the answers to a query of a listener so many bytes are kept: more than a thousand processes answer."""
RING = 256
"""Samples or queries in each ring of a polled sub-session."""
Priority = Literal["high", "normal", "low"]
"""high: rare messages that must arrive. low: whatever else waits is sent first."""
ZENOH_PRIORITY = {"high": zenoh.Priority.DATA_HIGH, "normal": zenoh.Priority.DATA, "low": zenoh.Priority.BACKGROUND}


@dataclass(slots=True)
class _PolledQuery:
    """The answers to a query until `poll`, at most RING: a flood of them must not hold up the session.

    finished: called by `poll` when all have answered, or the time is over.
    """

    take_in: Callable[[Any], None]
    finished: Callable[[], None]
    waiting: deque[Any] = field(default_factory=lambda: deque(maxlen=RING))
    has_ended: bool = False

    def end(self) -> None:
        """No more answers will arrive."""
        self.has_ended = True

    def empty(self) -> bool:
        """Pass on all answers that wait; returns whether more may arrive."""
        has_ended = self.has_ended
        for _ in range(len(self.waiting)):
            self.take_in(self.waiting.popleft())
        return not has_ended


class Publisher:
    """Publishes bytes under one key. Made by `SubSession.publisher`; safe to use from several threads."""

    def __init__(self, publisher: zenoh.Publisher) -> None:
        self._publisher = publisher

    def put(self, payload: bytes) -> None:
        """Send to the present subscribers, if any; raises LabanmeshError if the link is closed."""
        try:
            self._publisher.put(payload)
        except zenoh.ZError as error:
            raise LabanmeshError(f"the link to the mesh is closed: {error}") from None

    @property
    def has_subscriber(self) -> bool:
        """Whether anybody subscribes now; takes less than a microsecond."""
        # The stub of eclipse-zenoh 1.10 declares a bool; it is an object.
        now: Any = self._publisher.matching_status
        return bool(now.matching)

    def wait_for_subscriber(self, timeout_s: float) -> bool:
        """Whether there is a subscriber, within `timeout_s`."""
        matched = threading.Event()
        with self._publisher.declare_matching_listener(lambda status: matched.set() if status.matching else None):
            return self.has_subscriber or matched.wait(timeout_s)


class SubSession:
    """A part of a session on the mesh that can be closed alone; `close` ends all that was declared with it.

    session: of this process, or a part of it. polled: callbacks are called, and inboxes filled, only by `poll`.
    """

    def __init__(self, session: "zenoh.Session | SubSession", *, polled: bool = False) -> None:
        self._session: zenoh.Session = session._session if isinstance(session, SubSession) else session
        self._is_polled = polled
        self._declared: list[Any] = []
        self._inboxes: list[Inbox] = []
        self._rings: list[tuple[Callable[[], Any], Callable[[Any], None]]] = []
        """What returns the next entry of each ring, None if it is empty, and what takes it in."""
        self._queries: list[_PolledQuery] = []
        self._closed = threading.Event()

    def sub_session(self, *, polled: bool = False) -> "SubSession":
        """Another part of the same session, which outlives it."""
        return SubSession(self, polled=polled)

    def poll(self) -> None:
        """Process everything that waits in the rings of a polled sub-session, in this thread."""
        for try_recv, take_in in self._rings:
            # Samples that arrive meanwhile wait for the next poll: a flood must not hold the loop.
            for _ in range(RING):
                # Raises ZError if nothing more will arrive.
                if (entry := try_recv()) is None:
                    break
                take_in(entry)
        for query in tuple(self._queries) if self._queries else ():
            if not query.empty():
                self._queries.remove(query)
                query.finished()

    def publisher(self, key: str, *, priority: Priority = "normal") -> Publisher:
        """A publisher under `key`. On a slow line Zenoh sends, and drops, the messages of each priority apart."""
        publisher = self._session.declare_publisher(key, encoding=ENCODING, priority=ZENOH_PRIORITY[priority])
        self._declared.append(publisher)
        return Publisher(publisher)

    def inbox(self, *keys: str, limit: int = 4096, remote: bool = False, bytes_limit: int = BYTES_LIMIT) -> Inbox:
        """One inbox for everything published under `keys`, which may have wildcards; it drops the oldest over `limit`.

        remote: omit what this process publishes itself. bytes_limit: see Inbox.
        """
        inbox = Inbox(limit, bytes_limit)
        origin = zenoh.Locality.REMOTE if remote else None
        for key in keys:
            declare = partial(self._session.declare_subscriber, key, allowed_origin=origin)
            self._declare(declare, partial(_enqueue, inbox, None if "*" in key else key))
        self._inboxes.append(inbox)
        return inbox

    def newest(self, *keys: str) -> NewestMessages:
        """The newest message under each of `keys`, which have no wildcards; taken without `poll` and queue."""
        declared = [self._session.declare_subscriber(key, zenoh.handlers.RingChannel(1)) for key in keys]
        self._declared += declared
        return NewestMessages([(key, one.try_recv) for key, one in zip(keys, declared, strict=True)], _payload_of)

    def announce(self, key: str) -> None:
        """Declare a liveliness token under `key`, until the link is closed or the process dies."""
        self._declared.append(self._session.liveliness().declare_token(key))

    def presence(self, key_expression: str, expected: Iterable[str] = ()) -> Presence:
        """The liveliness tokens under `key_expression`, including those declared before. expected: see Presence."""
        presence = Presence(expected)

        def note(sample: zenoh.Sample) -> None:
            presence.note(str(sample.key_expr), alive=sample.kind == zenoh.SampleKind.PUT)

        declare = self._session.liveliness().declare_subscriber
        self._declare(partial(declare, key_expression, history=True), note)
        return presence

    def answer(self, key: str, last: Callable[[], bytes | Sequence[bytes] | None]) -> None:
        """Answer queries for `key` with what `last` returns: one payload, several with the newest last, or None.

        `last` must be fast.
        """

        def reply(query: zenoh.Query) -> None:
            with query:
                payloads = last()
                for payload in [payloads] if isinstance(payloads, bytes) else payloads or ():
                    query.reply(key, payload, encoding=ENCODING)

        self._declare(partial(self._session.declare_queryable, key, complete=True), reply)

    def answer_requests(self, key: str, respond: Callable[[bytes], bytes | None]) -> None:
        """Answer requests for exactly `key` with what `respond` makes of their payload; None: no answer.

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
        """The last payload under each key that matches `key`, which may have wildcards; empty after `timeout_s`."""
        return dict(self.ask_each(key, timeout_s))

    def ask_each(self, key: str, timeout_s: float) -> list[tuple[str, bytes]]:
        """All answers to a query for `key`, of one key the newest last; empty after `timeout_s`.

        The query is repeated while nobody answers, because the link may just have been opened.
        """
        waited_s = 0.0
        while not (replies := self._ask_once(key, timeout_s)) and waited_s < timeout_s:
            if self._closed.wait(RETRY_S):
                break
            waited_s += RETRY_S
        return replies

    def request(
        self,
        key: str,
        answered: Callable[[str, bytes], None],
        timeout_s: float,
        finished: Callable[[], None] = lambda: None,
        payload: bytes | None = None,
        longest: int = SIZE_LIMIT,
    ) -> None:
        """Query without waiting: `answered` gets each key and payload, in a thread of the mesh; it must be fast.

        finished: called once, when no more answers will arrive. payload: of the request. longest: bytes of an answer;
        longer ones are left out.
        """

        def pass_on(reply: zenoh.Reply) -> None:
            if reply.ok is not None and len(reply.ok.payload) <= longest:
                answered(str(reply.ok.key_expr), reply.ok.payload.to_bytes())

        # Not a ring, whose content is lost when the query ends.
        handler: Any = zenoh.handlers.Callback(pass_on, finished)
        query = _PolledQuery(pass_on, finished)
        if self._is_polled:
            # In Zenoh's own thread, which it does not hold up: a thread for each query would be too many.
            handler = zenoh.handlers.Callback(query.waiting.append, query.end, indirect=False)
        with contextlib.suppress(zenoh.ZError):  # closed: nobody will answer
            # Several may answer under one key, as for the vocabulary: each answer counts.
            each = zenoh.ConsolidationMode.NONE
            self._session.get(
                key, handler, target=zenoh.QueryTarget.ALL, consolidation=each, timeout=timeout_s, payload=payload
            )
            if self._is_polled:
                self._queries.append(query)

    def _ask_once(self, key: str, timeout_s: float) -> list[tuple[str, bytes]]:
        # Several answers of one key are a history, of which Zenoh would keep only one.
        each = zenoh.ConsolidationMode.NONE
        if self._session.is_closed():
            return []
        try:
            replies = self._session.get(key, target=zenoh.QueryTarget.ALL, consolidation=each, timeout=timeout_s)
        except zenoh.ZError:
            if self._session.is_closed():  # at this moment
                return []
            raise
        answers, size = [], 0
        for reply in replies:
            # All are received, or those that wait would hold up the session; of a flood only the first are kept.
            if reply.ok is not None and len(reply.ok.payload) <= SIZE_LIMIT and size < ANSWERS_BYTES:
                size += len(reply.ok.payload)
                answers.append((str(reply.ok.key_expr), reply.ok.payload.to_bytes()))
        return answers

    def close(self) -> None:
        """Undeclare everything and wake the threads that wait on an inbox; a second call does nothing."""
        self._closed.set()
        declared, self._declared, self._rings = self._declared, [], []
        for declaration in declared:
            with contextlib.suppress(zenoh.ZError):  # the session was closed before
                declaration.undeclare()
        for inbox in self._inboxes:
            inbox.wake()

    def _declare(self, declare: Callable[[Any], Any], take_in: Callable[[Any], None]) -> None:
        """Declare something whose samples or queries go to `take_in`."""
        declaration = declare(zenoh.handlers.RingChannel(RING) if self._is_polled else take_in)
        self._declared.append(declaration)
        if self._is_polled:
            self._rings.append((declaration.try_recv, take_in))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _enqueue(inbox: Inbox, key: str | None, sample: zenoh.Sample) -> None:
    """Put a sample in an inbox. key: the sample's, if it is known."""
    inbox.put(key or str(sample.key_expr), _payload_of(sample))


def _payload_of(sample: zenoh.Sample) -> bytes:
    payload = sample.payload
    # A payload that no message can have is not copied: a queue of them would fill the memory.
    return payload.to_bytes() if len(payload) <= SIZE_LIMIT else OVERSIZE
