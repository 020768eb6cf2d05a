"""The file of a scene's history: SQLite, one row for each movement and each fall, with its last word.

1. A row is on the disk when `add` returns: a kill afterwards loses nothing.
2. A later word replaces an earlier one; a word that comes late changes nothing.
3. What was kept too long ago, by this machine's clock, or is too much, is deleted by `delete_old`; deleted rows are
   overwritten. A fusion machine whose clock is wrong costs no row.
4. The program that writes is `labanmesh hub events`; corrections and forgetting are written by whoever does them.
"""

import logging
import sqlite3
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from common import SECOND_NS
from common.config import Scene
from common.teaching_messages import Unwanted
from common.text import plural
from hub.database import BUSY_S, DatabaseFault, faults_of, opened, opened_to_read, transaction
from hub.history.records import HistoryRow, Kind

HISTORY_VERSION = 1
HISTORY_SCHEMA = (
    "CREATE TABLE events (seq INTEGER PRIMARY KEY, kind TEXT NOT NULL, id TEXT NOT NULL, label TEXT NOT NULL, "
    "stage TEXT NOT NULL, began_ns INTEGER NOT NULL, at_ns INTEGER NOT NULL, ended_ns INTEGER, p REAL, k INTEGER, "
    "n INTEGER, revises TEXT, corrected TEXT, detail TEXT NOT NULL, "
    "kept_s INTEGER NOT NULL DEFAULT (CAST(strftime('%s', 'now') AS INTEGER)), UNIQUE (kind, id))",
    "CREATE INDEX events_began ON events (began_ns)",
    "CREATE INDEX events_label ON events (label, began_ns)",
)
ADD = (
    "INSERT INTO events (kind, id, label, stage, began_ns, at_ns, ended_ns, p, k, n, revises, detail) "
    "VALUES (:kind, :id, :label, :stage, :began_ns, :at_ns, :ended_ns, :p, :k, :n, :revises, :detail) "
    "ON CONFLICT (kind, id) DO UPDATE SET label = excluded.label, stage = excluded.stage, at_ns = excluded.at_ns, "
    "ended_ns = excluded.ended_ns, p = excluded.p, k = excluded.k, n = excluded.n, revises = excluded.revises, "
    "detail = excluded.detail WHERE excluded.at_ns > at_ns OR (excluded.at_ns = at_ns AND excluded.stage = 'ended')"
)
END_FALL = (
    "UPDATE events SET stage = :stage, ended_ns = :ended_ns, at_ns = :at_ns "
    "WHERE kind = 'fall' AND id = :id AND ended_ns IS NULL"
)
ROW_FIELDS = ", ".join(HistoryRow.__slots__)
DAY_NS, MB = 86_400 * SECOND_NS, 1_000_000
TOO_MUCH = 0.1
"""Share of the rows that are deleted at once when the file is too large."""
MOST_ROWS = 100_000
"""Rows of one answer."""


@dataclass(frozen=True, slots=True)
class HistoryQuery:
    """Which rows: all that fit, the newest first. kind, label: "" for any. from_ns: first begin, until_ns: after the
    last. limit: so many at most."""

    kind: Kind | str = ""
    label: str = ""
    from_ns: int | None = None
    until_ns: int | None = None
    limit: int = 1000

    def statement(self) -> tuple[str, list[object]]:
        """The SQL and its parameters."""
        conditions = {
            "kind = ?": self.kind or None,
            "label = ?": self.label or None,
            "began_ns >= ?": self.from_ns,
            "began_ns < ?": self.until_ns,
        }
        used = {text: value for text, value in conditions.items() if value is not None}
        where = f" WHERE {' AND '.join(used)}" if used else ""
        order = " ORDER BY began_ns DESC, seq DESC LIMIT ?"
        return f"SELECT {ROW_FIELDS} FROM events{where}{order}", [*used.values(), min(self.limit, MOST_ROWS)]  # noqa: S608


class HistoryFile:
    """An open history file, to read from and, unless it was opened by `to_read`, to write to."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path, self._connection = path, connection

    @classmethod
    def to_write(cls, path: Path, busy_s: float = BUSY_S) -> Self:
        """Open it, and make it if it is not there; raises DatabaseFault."""
        return cls(path, opened(path, HISTORY_VERSION, HISTORY_SCHEMA, busy_s=busy_s))

    @classmethod
    def to_read(cls, path: Path) -> Self:
        """Open it to read; raises DatabaseFault, also if it is not there."""
        return cls(path, opened_to_read(path, HISTORY_VERSION))

    def add(self, *rows: HistoryRow) -> None:
        """Keep these rows; they are on the disk when this returns. Raises DatabaseFault."""
        with transaction(self.path, self._connection) as connection:
            for row in rows:
                fields = {name: getattr(row, name) for name in HistoryRow.__slots__}
                is_end = row.kind == "fall" and row.stage == "up"
                connection.execute(END_FALL if is_end else ADD, fields)

    def correct(self, labels: dict[str, str]) -> int:
        """Note what movements were, by the id of their verdicts; how many are known. Raises DatabaseFault."""
        with transaction(self.path, self._connection) as connection:
            statement = "UPDATE events SET corrected = ? WHERE kind = 'verdict' AND id = ?"
            return sum(connection.execute(statement, (label, verdict)).rowcount for verdict, label in labels.items())

    def forget(self, label: str = "") -> int:
        """Delete the rows of a label, also of one that was corrected to or from it; all for "". Returns how many."""
        with transaction(self.path, self._connection) as connection:
            if label:
                statement = "DELETE FROM events WHERE ? IN (label, revises, corrected)"
                deleted = connection.execute(statement, (label,)).rowcount
            else:
                deleted = connection.execute("DELETE FROM events").rowcount
        self._compact()
        return deleted

    def delete_old(self, now_ns: int, keep_days: float, keep_mb: float) -> int:
        """Delete what is older than `keep_days`, and the oldest while the file has more than `keep_mb`; how many."""
        with transaction(self.path, self._connection) as connection:
            oldest_s = (now_ns - round(keep_days * DAY_NS)) // SECOND_NS
            deleted = connection.execute("DELETE FROM events WHERE kept_s < ?", (oldest_s,)).rowcount
            while self._used_bytes() > keep_mb * MB and (rows := self.rows):
                statement = "DELETE FROM events WHERE seq IN (SELECT seq FROM events ORDER BY seq LIMIT ?)"
                deleted += connection.execute(statement, (max(round(TOO_MUCH * rows), 1),)).rowcount
        if deleted:
            self._compact()
        return deleted

    @property
    def rows(self) -> int:
        """How many rows there are."""
        with faults_of(self.path):
            count: int = self._connection.execute("SELECT count(*) FROM events").fetchone()[0]
            return count

    def select(self, query: HistoryQuery) -> Sequence[HistoryRow]:
        """The rows that fit, the newest first; raises DatabaseFault."""
        with faults_of(self.path):
            return [HistoryRow(*row) for row in self._connection.execute(*query.statement())]

    def labels(self) -> list[str]:
        """All labels, in order."""
        with faults_of(self.path):
            return [row[0] for row in self._connection.execute("SELECT DISTINCT label FROM events ORDER BY label")]

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def _used_bytes(self) -> int:
        pages, free, size = (
            self._connection.execute(f"PRAGMA {each}").fetchone()[0]
            for each in ("page_count", "freelist_count", "page_size")
        )
        return int((pages - free) * size)

    def _compact(self) -> None:
        """Leave nothing of deleted rows in the log beside the file."""
        with faults_of(self.path):
            self._connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


log = logging.getLogger("labanmesh.hub")


def note_corrections(scene: Scene, labels: Mapping[str, str]) -> None:
    """Note what movements were, by the id of their verdicts; "" for none. A file that cannot be written is one line."""
    if not labels or not _is_here(scene):
        return
    try:
        with HistoryFile.to_write(scene.place(scene.history.file)) as file:
            file.correct(dict(labels))
    except DatabaseFault as error:
        log.warning("history: not corrected there: %s", error)


def forget_in_history(scene: Scene, unwanted: Unwanted) -> str:
    """Delete the rows of a movement, or all; one line that says what was done, "" for a scene without a history.

    Raises DatabaseFault if they are still there.
    """
    if not scene.history.file:
        return ""
    if not _is_here(scene):
        return "history: its file is not on this machine; give the command where labanmesh hub events runs"
    if unwanted.person:
        return "history: says of nobody who moved, so nothing is removed from it"
    with HistoryFile.to_write(scene.place(scene.history.file)) as file:
        return f"history: {plural(file.forget('' if unwanted.everything else unwanted.label), 'row')} removed"


def _is_here(scene: Scene) -> bool:
    return bool(scene.history.file) and scene.place(scene.history.file).exists()
