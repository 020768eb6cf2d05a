"""Queues between the mesh's threads and a service's loop: messages that arrived, and liveliness tokens."""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from common.arrival import Arrival as Arrival

LARGE_INBOX = 2048
"""Bytes of a payload from which it is counted; a queue of smaller ones is bounded by their number."""
BYTES_LIMIT = 16 << 20
"""All large payloads that wait in a queue: less than floods of the largest messages would fill."""
STRANGERS_LIMIT = 256
SHARE = 4
"""One key may fill a quarter of this, so that a flood under one key costs other keys nothing."""


class Inbox:
    """A bounded queue that one loop empties; what is lost is counted in `dropped`.

    Over `limit` messages the oldest are dropped. Payloads over LARGE_INBOX may have `bytes_limit` bytes together, and a
    quarter of it under one key; further ones are dropped until the next `take`.
    """

    def __init__(self, limit: int = 4096, bytes_limit: int = BYTES_LIMIT) -> None:
        self._arrivals: deque[Arrival] = deque(maxlen=limit)
        self._bell = threading.Lock()
        self._bell.acquire()
        self._lock = threading.Lock()
        self._bytes_limit = bytes_limit
        self._large: dict[str, int] = {}
        self._large_bytes = 0
        self.dropped = 0

    def put(self, key: str, payload: bytes) -> None:
        """Enqueue a message and return at once; called by the mesh's threads."""
        arrivals = self._arrivals
        if len(payload) > LARGE_INBOX and not self._has_room(key, len(payload)):
            return
        if len(arrivals) == arrivals.maxlen:
            with self._lock:
                self.dropped += 1
        arrivals.append(Arrival(key, payload, time.time_ns()))
        # Rung after the message is in the queue: `take` silences it first and empties then, so it cannot miss one.
        self.wake()

    def _has_room(self, key: str, size: int) -> bool:
        """Count a large payload, unless it is too much."""
        with self._lock:
            own = self._large.get(key, 0) + size
            fits = own <= self._bytes_limit // SHARE and self._large_bytes + size <= self._bytes_limit
            if not fits:
                self.dropped += 1
                return False
            self._large[key] = own
            self._large_bytes += size
            return True

    def take(self, timeout_s: float = 0.0) -> list[Arrival]:
        """All messages that have arrived, oldest first; waits for a message, a `wake`, or `timeout_s`."""
        if timeout_s <= 0 and not self._arrivals:
            return []
        self._bell.acquire(timeout=max(timeout_s, 0.0))
        if self._large_bytes:
            with self._lock:
                self._large.clear()
                self._large_bytes = 0
        # Messages that arrive meanwhile wait for the next call; otherwise this one might never end.
        return [self._arrivals.popleft() for _ in range(len(self._arrivals))]

    def wake(self) -> None:
        """Make the present or the next `take` return at once."""
        if self._bell.locked():
            try:  # noqa: SIM105 - quicker than `suppress`, and called for every message
                self._bell.release()
            except RuntimeError:
                pass  # another thread has rung it meanwhile


class NewestMessages:
    """The newest message under each of some keys, which waits in a ring of one until `take`.

    rings: each key, and what returns the sample in its ring, None if it is empty. payload_of: the bytes of a sample.
    """

    def __init__(
        self, rings: Sequence[tuple[str, Callable[[], Any]]] = (), payload_of: Callable[[Any], bytes] = bytes
    ) -> None:
        self._rings, self._payload_of = rings, payload_of

    def take(self) -> list[Arrival]:
        """Those that have arrived since the last call, at most one of each key; they count as arriving now."""
        arrivals = []
        for key, try_recv in self._rings:
            sample = try_recv()
            if sample is not None:
                arrivals.append(Arrival(key, self._payload_of(sample), time.time_ns()))
        return arrivals


class Presence:
    """The keys of the liveliness tokens that exist now; read by any thread.

    appearances: how many tokens have appeared so far; after this process's link was lost all appear anew.
    expected: the keys of processes that the scene names. Of others at most STRANGERS_LIMIT are noted, so that a process
    that invents names costs little.
    """

    def __init__(self, expected: Iterable[str] = ()) -> None:
        self._expected = frozenset(expected)
        self._alive: frozenset[str] = frozenset()
        self._changed = threading.Condition()
        self.appearances = 0

    def note(self, key: str, *, alive: bool) -> None:
        """Note that the token under `key` has appeared or gone; called by the mesh's threads."""
        with self._changed:
            if alive and key not in self._expected and len(self._alive - self._expected) >= STRANGERS_LIMIT:
                return
            self._alive = self._alive | {key} if alive else self._alive - {key}
            self.appearances += alive
            self._changed.notify_all()

    @property
    def alive(self) -> frozenset[str]:
        """The keys that are alive now."""
        return self._alive

    def wait_for(self, count: int, timeout_s: float) -> bool:
        """Whether exactly `count` keys are alive, within `timeout_s`; 0 waits until all are gone."""
        with self._changed:
            return self._changed.wait_for(lambda: len(self._alive) == count, timeout_s)
