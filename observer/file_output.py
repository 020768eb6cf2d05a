"""Writes whole files: atomically, or directly into a device or a pipe such as /dev/null."""

import os
from pathlib import Path

from common.errors import LabanmeshError

WAY_OUT = "Choose another path with -o"


def write_file(path: Path, content: bytes, way_out: str = WAY_OUT) -> None:
    """Write `content` to `path`; an existing regular file is replaced only when the new one is complete.

    way_out: the last sentence of an error. Raises LabanmeshError when the file cannot be written.
    """
    try:
        if path.exists() and not path.is_file() and not path.is_dir():
            path.write_bytes(content)
        else:
            _replace(path.resolve(), content)
    except OSError as error:
        reason = str(error.strerror or error)
        raise LabanmeshError(f"cannot write {path}: {reason[:1].lower()}{reason[1:]}. {way_out}") from None


def _replace(target: Path, content: bytes) -> None:
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
