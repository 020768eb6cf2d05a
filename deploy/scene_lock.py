"""Keeps a user from starting one scene twice on a machine: a lock in the folder for what runs."""

import fcntl
import os
import stat
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path

from common.config import Scene
from common.errors import LabanmeshError, reason_of


@contextmanager
def only_once(scene: Scene, folder: Path) -> Iterator[None]:
    """Until the block is left no other `up` of this user can enter it with this scene at the same meeting place.

    The scene counts, not its file: editors replace files, and any reader of a file can lock it. folder: the user's own,
    for the lock. Raises LabanmeshError, one line with the way out, if another one has entered. One
    that was killed does not count.
    """
    place = sha256(f"{scene.mesh.prefix} {scene.mesh.endpoint}".encode()).hexdigest()[:8]
    file = folder / f"labanmesh-{scene.scene}-{place}.lock"
    try:
        number = os.open(file, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    except OSError as error:
        raise LabanmeshError(
            f"cannot write {file}: {reason_of(error)}; name a folder of yours as XDG_RUNTIME_DIR"
        ) from None
    try:
        _lock(number, scene.scene)
        yield
    finally:
        os.close(number)


def _lock(number: int, scene: str) -> None:
    try:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise LabanmeshError(f"scene {scene!r}: labanmesh up runs already with it; stop that one first") from None


def runtime_folder(environment: Mapping[str, str], run: Path = Path("/run/user")) -> Path:
    """The folder for what runs, which only this user can write: XDG_RUNTIME_DIR, RUN/UID, or a new temporary one.

    Raises LabanmeshError, one line, if somebody else has taken the temporary one.
    """
    user = os.getuid()
    for folder in (Path(environment.get("XDG_RUNTIME_DIR") or run / str(user)), run / str(user)):
        if _is_own(folder):
            return folder
    folder = Path(tempfile.gettempdir()) / f"labanmesh-{user}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        raise LabanmeshError(
            f"cannot write {folder}: {reason_of(error)}; name a folder of yours as XDG_RUNTIME_DIR"
        ) from None
    if not _is_own(folder):
        raise LabanmeshError(f"{folder}: others can write there; name a folder of yours as XDG_RUNTIME_DIR")
    return folder


def _is_own(folder: Path) -> bool:
    """Whether it is a folder of this user, no link, that nobody else can write."""
    try:
        status = folder.lstat()
    except OSError:
        return False
    closed = not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and closed
