"""Writes whole files: atomically, or directly into a device or a pipe such as /dev/null."""

import os
from pathlib import Path

from common.errors import BadInput, LabanmeshError

WAY_OUT = "Choose another path with -o"


def write_file(path: Path, content: bytes | memoryview, way_out: str = WAY_OUT) -> None:
    """Write `content` to `path`; an existing regular file is replaced only when the new one is complete.

    way_out: the last sentence of an error. Raises BadInput if the path cannot be written to (no such folder, a folder,
    permission denied), LabanmeshError if writing fails, e.g. because the disk is full.
    """
    try:
        if path.exists() and not path.is_file() and not path.is_dir():
            path.write_bytes(content)
        else:
            _replace(path.resolve(), content)
    except OSError as error:
        reason = str(error.strerror or error)
        wrong_path = isinstance(error, FileNotFoundError | IsADirectoryError | NotADirectoryError | PermissionError)
        kind = BadInput if wrong_path else LabanmeshError
        raise kind(f"cannot write {path}: {reason[:1].lower()}{reason[1:]}. {way_out}") from error


def _replace(target: Path, content: bytes | memoryview) -> None:
    # In the same folder: replacing is atomic only within one file system.
    unfinished = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        with unfinished.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        unfinished.replace(target)
    finally:
        # Also after Ctrl-C; after success there is nothing left to remove.
        unfinished.unlink(missing_ok=True)
