"""Reading small text files of people, and writing files that nobody could make again."""

import os
import tomllib
from contextlib import suppress
from pathlib import Path
from typing import Any

TEXT_LIMIT = 16 * 2**20
"""Bytes of a text file: no scene, camera or register is that long, and a device without end is."""


def read_text(path: Path, limit: int = TEXT_LIMIT) -> str:
    """The text of the file at `path`, UTF-8.

    Raises OSError, and ValueError, one line, for anything that is no such text, or longer than `limit` bytes.
    """
    # A NUL in a name is a ValueError of its own.
    with path.open("rb") as file:
        content = file.read(limit + 1)
    if len(content) > limit:
        raise ValueError(f"longer than {limit >> 20} MB")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        raise ValueError("not UTF-8 text") from None


def parse_toml(text: str) -> dict[str, Any]:
    """The table in a TOML text; raises ValueError, one line, for anything else."""
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    except ValueError as error:
        # Of tomllib itself, or for a number of thousands of digits, or an impossible date.
        raise ValueError(str(error).partition(";")[0]) from None


def read_toml(path: Path) -> dict[str, Any]:
    """The table in the TOML file at `path`; raises OSError, and ValueError, one line, for anything else."""
    return parse_toml(read_text(path))


def replace_file(path: Path, content: bytes | memoryview, mode: int = 0o666) -> None:
    """Write `content` to `path` so that a crash, or a loss of power, leaves the old file or the new one, complete.

    mode: of the new file, less the process's umask. Raises OSError.
    """
    # In the same folder: replacing is atomic only within one file system.
    unfinished = path.with_name(f".{path.name[:200]}.{os.getpid()}.part")
    try:
        with os.fdopen(os.open(unfinished, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, mode), "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        unfinished.replace(path)
        sync_folder(path.parent)
    finally:
        # Also after Ctrl-C; after success there is nothing left to remove.
        unfinished.unlink(missing_ok=True)


def sync_folder(folder: Path) -> None:
    """Write the names in `folder` to the disk: a new or renamed file is found again after a loss of power."""
    number = os.open(folder, os.O_RDONLY)
    try:
        # Some network file systems cannot.
        with suppress(OSError):
            os.fsync(number)
    finally:
        os.close(number)
