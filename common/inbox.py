"""What waits between the mesh's threads and a service's loop: arrived messages, and who is alive."""

import threading
import time
from collections import deque
from typing import NamedTuple


class Arrival(NamedTuple):
    """One message as it came: its key, its bytes, and when it arrived here (Unix epoch).

    A tuple: tens of thousands a second are made.
    """

    key: str
    payload: bytes
    arrived_ns: int


class Inbox:
    """A bounded queue that one loop empties: past `limit` the oldest go, and are counted in `dropped`."""

    def __init__(self, limit: int = 4096) -> None:
        self._arrivals: deque[Arrival] = deque(maxlen=limit)
        self._something = threading.Event()
        self._lock = threading.Lock()
        self.dropped = 0

    def put(self, key: str, payload: bytes) -> None:
        """Called by the mesh's threads: enqueue and return at once."""
        arrivals = self._arrivals
        if len(arrivals) == arrivals.maxlen:
            with self._lock:
                self.dropped += 1
        arrivals.append(Arrival(key, payload, time.time_ns()))
        # After it is in the queue: `take` clears first and empties then, so it cannot be overlooked.
        if not self._something.is_set():
            self._something.set()

    def take(self, timeout_s: float) -> list[Arrival]:
        """All that has arrived, oldest first; waits for something, a `wake`, or `timeout_s`. May be empty."""
        self._something.wait(timeout_s)
        self._something.clear()
        # What comes meanwhile stays for the next time, or this would never end.
        return [self._arrivals.popleft() for _ in range(len(self._arrivals))]

    def wake(self) -> None:
        """Make a waiting or the next `take` return at once."""
        self._something.set()


class Presence:
    """The keys that are alive now; read by any thread."""

    def __init__(self) -> None:
        self._alive: frozenset[str] = frozenset()
        self._changed = threading.Condition()

    def note(self, key: str, *, alive: bool) -> None:
        """Called by the mesh's threads: `key` came or went."""
        with self._changed:
            self._alive = self._alive | {key} if alive else self._alive - {key}
            self._changed.notify_all()

    @property
    def alive(self) -> frozenset[str]:
        """The keys that are alive now."""
        return self._alive

    def wait_for(self, count: int, timeout_s: float) -> bool:
        """Whether exactly `count` keys are alive, within `timeout_s`; 0 waits until all have gone."""
        with self._changed:
            return self._changed.wait_for(lambda: len(self._alive) == count, timeout_s)
