"""Reads and writes files of named arrays (.npz without pickles)."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput, LabanmeshError

WAY_OUT = "Choose another path with -o"


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]], *, compressed: bool) -> None:
    """Write the arrays to `path`; an existing file is replaced only when the new one is complete.

    A device or a pipe, such as /dev/null, is written to and not replaced. Raises BadInput if the folder is missing,
    `path` is a folder or may not be written, and LabanmeshError if writing fails, e.g. because the disk is full.
    """
    if path.is_dir():
        raise BadInput(f"cannot write {path}: it is a folder. Name a file with -o")
    if not path.parent.is_dir():
        raise BadInput(
            f"cannot write {path}: folder {path.parent} does not exist. Make it first, or choose another path"
        )
    try:
        if path.exists() and not path.is_file():
            with path.open("wb") as device:
                _save(device, arrays, compressed)
        else:
            _replace_file(path.resolve(), arrays, compressed)
    except PermissionError:
        raise BadInput(f"cannot write {path}: permission denied. {WAY_OUT}") from None
    except OSError as error:
        reason = str(error.strerror or error)
        raise LabanmeshError(f"cannot write {path}: {reason[:1].lower()}{reason[1:]}. {WAY_OUT}") from error


def _replace_file(target: Path, arrays: Mapping[str, NDArray[Any]], compressed: bool) -> None:
    # In the same folder: replacing is atomic only within one file system.
    unfinished = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        with unfinished.open("wb") as file:
            _save(file, arrays, compressed)
            file.flush()
            os.fsync(file.fileno())
        unfinished.replace(target)
    finally:
        # Also after Ctrl-C; after success there is nothing left to remove.
        unfinished.unlink(missing_ok=True)


def _save(file: IO[bytes], arrays: Mapping[str, NDArray[Any]], compressed: bool) -> None:
    save = np.savez_compressed if compressed else np.savez
    # No allow_pickle=False: numpy 1.26 would store it as an array. What is written here holds no objects.
    save(file, **arrays)  # type: ignore[arg-type]


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """All arrays of a file; raises OSError (FileNotFoundError), ValueError, EOFError or BadZipFile if it is invalid."""
    # Opened here: numpy leaves a broken zip open.
    with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}
