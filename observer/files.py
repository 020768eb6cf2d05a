"""Writes whole files, atomically or directly into a device such as /dev/null; files of named arrays (.npz); TOML."""

import errno
import os
import stat
import zipfile
from collections.abc import Mapping
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput, LabanmeshError, reason_of
from common.files import read_toml, replace_file

OTHER_PATH = "Choose another path with -o"
SHARED, PRIVATE = 0o666, 0o600
"""Modes of files, less the umask: those that somebody asks for by name, and those that hold people's motion unasked."""
UNPACKED_BYTES, UNPACKED_TIMES = 64 * 2**20, 100
"""What a file of arrays may unpack to, beyond so many times its own size: motion packs ten times, at most."""


def write_file(path: Path, content: bytes | memoryview, way_out: str = OTHER_PATH, mode: int = SHARED) -> None:
    """Write `content` to `path`; an existing regular file is replaced only when the new one is complete.

    way_out: the last sentence of an error. mode: of the file, whatever that of an existing one is. Raises BadInput if
    the path cannot be written to (no such folder, a folder, permission denied), LabanmeshError if writing fails, e.g.
    because the disk is full.
    """
    try:
        if path.exists() and not path.is_file() and not path.is_dir():
            path.write_bytes(content)
        else:
            replace_file(path.resolve(), content, mode)
    except OSError as error:
        raise _unwritable(path, error, way_out) from error


def require_writable_path(path: Path, way_out: str = OTHER_PATH) -> None:
    """Check, before long work, that `write_file` can write to `path`; raises BadInput as it does."""
    folder = path.resolve().parent
    if path.is_dir():
        number = errno.EISDIR
    elif not folder.exists():
        number = errno.ENOENT
    elif not os.access(folder, os.W_OK):
        number = errno.EACCES
    else:
        return
    raise _unwritable(path, OSError(number, os.strerror(number)), way_out)


def _unwritable(path: Path, error: OSError, way_out: str) -> LabanmeshError:
    reason = reason_of(error)
    wrong_path = isinstance(error, FileNotFoundError | IsADirectoryError | NotADirectoryError | PermissionError)
    kind = BadInput if wrong_path else LabanmeshError
    return kind(f"cannot write {path}: {reason[:1].lower()}{reason[1:]}. {way_out}")


def toml_of(path: Path, expected: str) -> dict[str, Any]:
    """The table in a TOML file; raises BadInput naming the file, the reason and what is expected."""
    try:
        return read_toml(path)
    except OSError as error:
        raise BadInput(f"cannot read {path}: {reason_of(error)}; {expected}") from None
    except ValueError as error:
        raise BadInput(f"{path}: not a TOML file: {error}; {expected}") from None


def remove_file(path: Path) -> None:
    """Remove a file, if there is one; raises LabanmeshError, one line."""
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise LabanmeshError(f"{path}: cannot be removed: {reason_of(error)}. Remove it by hand") from None


def make_private(path: Path) -> None:
    """Let nobody else read the file; nothing happens where that cannot be, or there is none."""
    with suppress(OSError):
        path.chmod(PRIVATE)


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]], *, compressed: bool, mode: int = SHARED) -> None:
    """Write the arrays as an .npz file without pickles; raises BadInput or LabanmeshError as `write_file` does."""
    content = BytesIO()
    save = np.savez_compressed if compressed else np.savez
    # No allow_pickle=False: numpy 1.26 would store it as an array. The arrays contain no objects.
    save(content, **arrays)  # type: ignore[arg-type]
    write_file(path, content.getbuffer(), mode=mode)


def require_unpackable(file: IO[bytes]) -> None:
    """Raises ValueError, one line, if the open .npz file unpacks to far more than arrays of numbers do."""
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode) or not zipfile.is_zipfile(file):
        raise ValueError("not a whole .npz file, which is a zip of arrays")
    packed = file.seek(0, os.SEEK_END)
    with zipfile.ZipFile(file) as members:
        unpacked = sum(member.file_size for member in members.infolist())
    file.seek(0)
    if unpacked > UNPACKED_BYTES + UNPACKED_TIMES * packed:
        raise ValueError(f"{packed / 1e3:.0f} KB that unpack to {unpacked / 1e6:.0f} MB: made to fill the memory")


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """All arrays of a file; raises FileNotFoundError, and ValueError with one line for a file that cannot be read."""
    arrays: dict[str, NDArray[Any]] = {}
    name = ""
    try:
        # Opened here: numpy leaves a broken zip open.
        with path.open("rb") as opened:
            require_unpackable(opened)
            with np.load(opened, allow_pickle=False) as file:
                for name in file.files:
                    arrays[name] = file[name]
                    if not isinstance(arrays[name], np.ndarray):
                        raise ValueError("not an array")
    except FileNotFoundError:
        raise
    # The errors of zipfile, zlib, tokenize and numpy for broken files have no common base class.
    except Exception as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise ValueError(f"{name}: {reason}" if name else reason) from error
    return arrays
