"""Queues between the mesh's threads and a service's loop: messages that arrived, and liveliness tokens."""

import threading
import time
from collections import deque
from typing import NamedTuple


class Arrival(NamedTuple):
    """One message: its key, its bytes, and when it arrived here (Unix epoch).

    A tuple, because tens of thousands are made per second.
    """

    key: str
    payload: bytes
    arrived_ns: int


class Inbox:
    """A bounded queue that one loop empties. Over `limit` the oldest messages are dropped and counted in `dropped`."""

    def __init__(self, limit: int = 4096) -> None:
        self._arrivals: deque[Arrival] = deque(maxlen=limit)
        self._something = threading.Event()
        self._lock = threading.Lock()
        self.dropped = 0

    def put(self, key: str, payload: bytes) -> None:
        """Enqueue a message and return at once; called by the mesh's threads."""
        arrivals = self._arrivals
        if len(arrivals) == arrivals.maxlen:
            with self._lock:
                self.dropped += 1
        arrivals.append(Arrival(key, payload, time.time_ns()))
        # Set after the message is in the queue: `take` clears first and empties then, so it cannot miss one.
        if not self._something.is_set():
            self._something.set()

    def take(self, timeout_s: float) -> list[Arrival]:
        """All messages that have arrived, oldest first; waits for a message, a `wake`, or `timeout_s`."""
        self._something.wait(timeout_s)
        self._something.clear()
        # Messages that arrive meanwhile wait for the next call; otherwise this one might never end.
        return [self._arrivals.popleft() for _ in range(len(self._arrivals))]

    def wake(self) -> None:
        """Make the present or the next `take` return at once."""
        self._something.set()


class Presence:
    """The keys of the liveliness tokens that exist now; read by any thread."""

    def __init__(self) -> None:
        self._alive: frozenset[str] = frozenset()
        self._changed = threading.Condition()

    def note(self, key: str, *, alive: bool) -> None:
        """The token under `key` has appeared or gone; called by the mesh's threads."""
        with self._changed:
            self._alive = self._alive | {key} if alive else self._alive - {key}
            self._changed.notify_all()

    @property
    def alive(self) -> frozenset[str]:
        """The keys that are alive now."""
        return self._alive

    def wait_for(self, count: int, timeout_s: float) -> bool:
        """Whether exactly `count` keys are alive, within `timeout_s`; 0 waits until all are gone."""
        with self._changed:
            return self._changed.wait_for(lambda: len(self._alive) == count, timeout_s)
