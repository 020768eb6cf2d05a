"""What is still to be told: a queue on disk, in order, for each receiver; and a thread for each that sends.

Nothing else waits for a receiver, and all is bounded.

1. One file holds the queues of all receivers of a scene, and the keys of what was put into them, so that nothing is
   told twice after a restart.
2. A POST ends within a time limit, follows no redirects, and reads little of the answer, whatever it is.
"""

import http.client
import json
import logging
import socket
import sqlite3
import ssl
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from common import SECOND_NS
from common.backoff import Backoff
from common.config_hub import NotifyConfig
from common.message_types import printable
from common.text import plural
from hub.database import BUSY_S, DatabaseFault, faults_of, opened, transaction
from hub.notify.notification import Notification, WebhookRequest, signed

QUEUE_VERSION = 1
QUEUE_SCHEMA = (
    "CREATE TABLE waiting (seq INTEGER PRIMARY KEY AUTOINCREMENT, name TEXT NOT NULL, since_ns INTEGER NOT NULL, "
    "headers TEXT NOT NULL, body BLOB NOT NULL)",
    "CREATE INDEX waiting_name ON waiting (name, seq)",
    "CREATE TABLE told (seq INTEGER PRIMARY KEY AUTOINCREMENT, name TEXT NOT NULL, key TEXT NOT NULL, "
    "label TEXT NOT NULL, at_ns INTEGER NOT NULL, UNIQUE (name, key))",
)
TOLD_LIMIT = 1000
"""Keys that are remembered, of all receivers."""


@dataclass(frozen=True, slots=True)
class Waiting:
    """A request that waits since `since_ns`."""

    seq: int
    since_ns: int
    request: WebhookRequest


class NotificationQueue:
    """The queues of one scene; safe to use from several threads. Every method raises DatabaseFault."""

    def __init__(self, path: Path, busy_s: float = BUSY_S) -> None:
        self.path = path
        self._connection: sqlite3.Connection = opened(path, QUEUE_VERSION, QUEUE_SCHEMA, busy_s=busy_s)
        self._lock = threading.Lock()

    def put(self, name: str, note: Notification, request: WebhookRequest, config: NotifyConfig, now_ns: int) -> int:
        """Append a request, unless it was put before, its label cools down, or what it follows was never told.

        Returns how many old ones had to go for it.
        """
        with self._lock, transaction(self.path, self._connection) as connection:
            if self._is_told(connection, name, note, config.cooldown_s):
                return 0
            entry = (name, note.key, note.label, note.at_ns)
            connection.execute("INSERT INTO told (name, key, label, at_ns) VALUES (?, ?, ?, ?)", entry)
            connection.execute("DELETE FROM told WHERE seq <= (SELECT max(seq) FROM told) - ?", (TOLD_LIMIT,))
            row = (name, now_ns, json.dumps(dict(request.headers)), request.body)
            connection.execute("INSERT INTO waiting (name, since_ns, headers, body) VALUES (?, ?, ?, ?)", row)
            oldest = "SELECT seq FROM waiting WHERE name = ? ORDER BY seq DESC LIMIT -1 OFFSET ?"
            return connection.execute(f"DELETE FROM waiting WHERE seq IN ({oldest})", (name, config.keep)).rowcount  # noqa: S608

    def oldest(self, name: str) -> Waiting | None:
        """The request of this receiver that has waited for the longest time; None if none waits."""
        with self._lock, faults_of(self.path):
            statement = "SELECT seq, since_ns, headers, body FROM waiting WHERE name = ? ORDER BY seq LIMIT 1"
            row = self._connection.execute(statement, (name,)).fetchone()
        return None if row is None else Waiting(row[0], row[1], WebhookRequest(json.loads(row[2]), row[3]))

    def remove(self, seq: int) -> None:
        """Delete a request that has been delivered, or never can be."""
        with self._lock, transaction(self.path, self._connection) as connection:
            connection.execute("DELETE FROM waiting WHERE seq = ?", (seq,))

    def count(self, name: str) -> int:
        """How many wait for this receiver."""
        with self._lock, faults_of(self.path):
            number: int = self._connection.execute("SELECT count(*) FROM waiting WHERE name = ?", (name,)).fetchone()[0]
            return number

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._connection.close()

    @staticmethod
    def _is_told(connection: sqlite3.Connection, name: str, note: Notification, cooldown_s: float) -> bool:
        is_told = "SELECT 1 FROM told WHERE name = ? AND key = ?"
        if connection.execute(is_told, (name, note.key)).fetchone():
            return True
        if note.after and not connection.execute(is_told, (name, note.after)).fetchone():
            return True
        # By the time of the event: a clock that was set back begins anew.
        newest = "SELECT at_ns FROM told WHERE name = ? AND label = ? ORDER BY seq DESC LIMIT 1"
        row = connection.execute(newest, (name, note.label)).fetchone()
        return row is not None and 0 <= note.at_ns - row[0] < cooldown_s * SECOND_NS


log = logging.getLogger("labanmesh.hub")
HOUR_NS = 3600 * SECOND_NS
IDLE_S = 1.0
SENDING = Backoff(1.0, 300.0)
ANSWER_CHARACTERS = 120
"""Bytes of an error's answer that are shown."""
LATER = frozenset({401, 403, 404, 405, 408, 425, 429})
"""Refusals that somebody or time may mend: the request waits. After any other of 400 to 499 it is never accepted."""


@dataclass(frozen=True, slots=True)
class WebhookResult:
    """fault: why it was not accepted, one line; "": it was. is_final: it never will be."""

    fault: str = ""
    is_final: bool = False


def post(url: str, request: WebhookRequest, timeout_s: float) -> WebhookResult:
    """Send one request; returns within about `timeout_s`."""
    parts = urlsplit(url)
    host, path = parts.hostname or "", (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
    secure = parts.scheme == "https"
    kind = http.client.HTTPSConnection if secure else http.client.HTTPConnection
    connection = kind(host, parts.port, timeout=timeout_s)
    over = threading.Event()

    def give_up() -> None:
        """A server that sends a byte now and then would hold a plain time limit off for ever."""
        over.set()
        if connection.sock is not None:
            try:
                connection.sock.shutdown(socket.SHUT_RDWR)
            except OSError:
                return

    timer = threading.Timer(timeout_s, give_up)
    timer.daemon = True
    timer.start()
    try:
        connection.request("POST", path, request.body, dict(request.headers))
        result = _result(connection.getresponse())
        # A server that never ends its headers has not answered.
        return WebhookResult(f"no answer within {timeout_s:g} s") if over.is_set() else result
    except (OSError, http.client.HTTPException, ssl.SSLError, ValueError) as error:
        if over.is_set() or isinstance(error, TimeoutError):
            return WebhookResult(f"no answer within {timeout_s:g} s")
        return WebhookResult(_reason(error))
    finally:
        timer.cancel()
        connection.close()


def _result(response: http.client.HTTPResponse) -> WebhookResult:
    status = response.status
    if 200 <= status < 300:
        return WebhookResult()
    if 300 <= status < 400:
        where = printable(response.getheader("Location") or "elsewhere")[:ANSWER_CHARACTERS]
        return WebhookResult(f"redirects to {where}; write that address, if it is the right one")
    text = " ".join(response.read(ANSWER_CHARACTERS).decode("utf-8", "replace").split())
    words = printable(f"answers {status} {response.reason}" + (f": {text}" if text else ""))
    return WebhookResult(words, is_final=400 <= status < 500 and status not in LATER)


def _reason(error: Exception) -> str:
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"its certificate is not accepted: {error.verify_message}"
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return printable(text.lower())[:ANSWER_CHARACTERS]


@dataclass(frozen=True, slots=True)
class Receiver:
    """A [notify.NAME] of the scene file, with its secrets."""

    name: str
    config: NotifyConfig
    url: str
    token: str = ""
    secret: str = ""

    def send(self, request: WebhookRequest) -> WebhookResult:
        """Send one request now."""
        return post(self.url, signed(request, self.secret, int(time.time())), self.config.timeout_s)


class WebhookSender:
    """The thread; clock: Unix epoch in ns."""

    def __init__(
        self,
        receiver: Receiver,
        queue: NotificationQueue,
        backoff: Backoff = SENDING,
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        self._receiver, self._queue, self._clock = receiver, queue, clock
        self._backoff = backoff
        self._wake, self._ended = threading.Event(), threading.Event()
        self._failures, self._fault = 0, ""
        self._thread = threading.Thread(target=self._run, name=f"notify-{receiver.name}", daemon=True)
        self._thread.start()

    def wake(self) -> None:
        """Send at once: a new notification waits in the queue."""
        self._wake.set()

    def close(self) -> None:
        """End after the request that is being sent; what waits stays in the queue."""
        self._ended.set()
        self._wake.set()
        self._thread.join(self._receiver.config.timeout_s + 1.0)

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                waiting = self._queue.oldest(self._receiver.name)
                pause_s = IDLE_S if waiting is None else self._send(waiting)
            except DatabaseFault as error:
                pause_s = self._failed(str(error))
            if self._failures:
                # Not woken by what is new: it comes after what could not be sent.
                self._ended.wait(pause_s)
            elif pause_s:
                self._wake.wait(pause_s)
                self._wake.clear()

    def _send(self, waiting: Waiting) -> float:
        if self._clock() - waiting.since_ns > self._receiver.config.keep_hours * HOUR_NS:
            self._queue.remove(waiting.seq)
            log.warning("notify.%s: given up after %g h: %s", self._receiver.name, self._receiver.config.keep_hours,
                        waiting.request.headers.get("X-Labanmesh-Id", ""))  # fmt: skip
            return 0.0
        result = self._receiver.send(waiting.request)
        if result.fault and not result.is_final:
            return self._failed(result.fault)
        self._queue.remove(waiting.seq)
        if result.fault:
            log.warning("notify.%s: refused for good: %s", self._receiver.name, result.fault)
        elif self._failures:
            log.warning("notify.%s: works again after %s", self._receiver.name, plural(self._failures, "failure"))
        self._failures, self._fault = 0, ""
        return 0.0

    def _failed(self, fault: str) -> float:
        self._failures += 1
        if fault != self._fault:
            self._fault = fault
            log.warning("notify.%s: %s; it is tried again, and what is due waits", self._receiver.name, fault)
        return self._backoff.wait_s(self._failures)
