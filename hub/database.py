"""SQLite files of a hub: opened safely, and their faults in one line each."""

import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from common.errors import LabanmeshError, reason_of

BUSY_S = 5.0
"""So long a writer waits for another one."""
SQLITE_FAULTS = {
    sqlite3.SQLITE_BUSY: "locked by another program; end it, or wait",
    sqlite3.SQLITE_LOCKED: "locked by another program; end it, or wait",
    sqlite3.SQLITE_FULL: "the disk is full; make room",
    sqlite3.SQLITE_READONLY: "cannot be written; make the hub's user its owner",
    sqlite3.SQLITE_CANTOPEN: "cannot be opened; is its folder there, and may this user read it?",
    sqlite3.SQLITE_IOERR: "the disk cannot be read or written",
    sqlite3.SQLITE_CORRUPT: "damaged; move it away, and a new one is begun",
    sqlite3.SQLITE_NOTADB: "not a SQLite file; move it away, and a new one is begun",
}
DAMAGED = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)


class DatabaseFault(LabanmeshError):  # noqa: N818 - like BadInput: it names what is at fault
    """A file cannot be used now. is_damaged: it never can again."""

    def __init__(self, text: str, *, is_damaged: bool = False) -> None:
        super().__init__(text)
        self.is_damaged = is_damaged


@contextmanager
def faults_of(path: Path) -> Iterator[None]:
    """SQLite's errors as one line that names the file and the way out."""
    try:
        yield
    except sqlite3.Error as error:
        # The lower byte is the kind, the others say more about it.
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF
        raise DatabaseFault(f"{path}: {SQLITE_FAULTS.get(code, str(error))}", is_damaged=code in DAMAGED) from None


def opened(path: Path, version: int, schema: Sequence[str], *, busy_s: float = BUSY_S) -> sqlite3.Connection:
    """The file at `path` to write to, made if it is not there; only its owner may read it.

    A commit has reached the disk when it returns. Raises DatabaseFault, also for a file of a newer version.
    """
    with faults_of(path):
        if not path.exists():
            # Before there is anything in it.
            try:
                path.touch(mode=0o600)
            except OSError as error:
                raise DatabaseFault(f"{path}: {reason_of(error)}") from None
        connection = sqlite3.connect(path, busy_s, isolation_level=None, check_same_thread=False)
        try:
            _prepare(path, connection, version, schema)
        except BaseException:
            connection.close()
            raise
        return connection


def opened_to_read(path: Path, version: int) -> sqlite3.Connection:
    """The file at `path` to read from; raises DatabaseFault, also if there is none yet."""
    if not path.exists():
        raise DatabaseFault(
            f"{path}: nothing has been kept yet; labanmesh up, or labanmesh hub events, keeps what happens from then on"
        )
    with faults_of(path):
        connection = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", BUSY_S, uri=True, isolation_level=None)
        connection.row_factory = sqlite3.Row
        try:
            _require_version(path, connection, version)
        except BaseException:
            connection.close()
            raise
        return connection


@contextmanager
def transaction(path: Path, connection: sqlite3.Connection) -> Iterator[sqlite3.Connection]:
    """All or nothing of what is done inside; it is on the disk afterwards. Raises DatabaseFault."""
    with faults_of(path):
        connection.execute("BEGIN IMMEDIATE")
        try:
            yield connection
            connection.execute("COMMIT")
        except BaseException:
            if connection.in_transaction:
                connection.execute("ROLLBACK")
            raise


def _prepare(path: Path, connection: sqlite3.Connection, version: int, schema: Sequence[str]) -> None:
    connection.row_factory = sqlite3.Row
    for pragma in ("journal_mode = WAL", "synchronous = FULL", "secure_delete = ON"):
        connection.execute(f"PRAGMA {pragma}")
    if _require_version(path, connection, version) < version:
        with transaction(path, connection):
            for statement in schema:
                connection.execute(statement)
            connection.execute(f"PRAGMA user_version = {version}")


def _require_version(path: Path, connection: sqlite3.Connection, version: int) -> int:
    written: int = connection.execute("PRAGMA user_version").fetchone()[0]
    if written > version:
        raise DatabaseFault(
            f"{path}: of version {written}, written by a newer labanmesh; this one reads up to {version}"
        )
    return written
