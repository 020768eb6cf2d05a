"""What is still to be told: a queue on disk, in order, for each receiver. Bounded.

One file holds the queues of all receivers of a scene, and the keys of what was put into them, so that nothing is told
twice after a restart.
"""

import json
import sqlite3
import threading
from dataclasses import dataclass
from pathlib import Path

from common import SECOND_NS
from common.config_events import NotifyConfig
from hub.database import BUSY_S, faults_of, opened, transaction
from hub.notify.notification import Notification, WebhookRequest

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
