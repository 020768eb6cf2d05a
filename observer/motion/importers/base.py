"""What an importer is, and functions that they share to read text files."""

import io
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput, reason_of
from common.text import plural
from observer.motion.archive import LARGEST, MotionArchive

T = TypeVar("T")
Progress = Callable[[int, int], None]
"""Called with the number of files or recordings done, and their total."""


@dataclass(frozen=True, slots=True)
class ImportResult:
    """An archive, and lines for people about what was left out, assumed or converted."""

    archive: MotionArchive
    notes: tuple[str, ...] = ()


RECORDING_FILE_LIMIT = 512 * 2**20
"""Bytes of a text file of motion: hours of it."""
Importer = Callable[[Path, Progress | None], ImportResult]
"""Reads all recordings of one kind at a path, a file or a folder, with every body part that the source has; hands and
head come first, as in `observer.tracks.WHOLE_BODY`. Raises BadInput, one line with the file, the place in it and what
is expected."""


def files_at(path: Path, pattern: str, what: str) -> tuple[Path, ...]:
    """`path` itself when it is a file, else its files that match `pattern`, else those one folder below; sorted.

    what: description of the files, for the error if there are none.
    """
    if os.path.isfile(path):  # noqa: PTH113 - False, not OSError, for a name that cannot be one
        return (path,)
    if not os.path.isdir(path):  # noqa: PTH112
        raise BadInput(f"{str(path)[:200]}: no such file or folder; {what} expected")
    files = sorted(path.glob(pattern)) or sorted(path.glob(f"*/{pattern}"))
    if not files:
        raise BadInput(f"{path}: nothing to import here; {what} expected")
    return tuple(files)


def counted(items: Iterable[T], total: int, progress: Progress | None) -> Iterator[T]:
    """The items; after each one `progress` is called."""
    for done, item in enumerate(items, 1):
        yield item
        if progress:
            progress(done, total)


def require_same_parts(file: Path, parts: tuple[str, ...], first_file: Path, first: tuple[str, ...]) -> None:
    """Raise BadInput if a file has other body parts than the first one."""
    if parts != first:
        theirs, ours = ", ".join(parts), ", ".join(first)
        raise BadInput(f"{file}: contains {theirs}, but {first_file} {ours}; the same parts are expected")


def read_text(path: Path) -> str:
    """The whole text of a file, with any line endings; a byte order mark is skipped."""
    try:
        with path.open("rb") as file:
            content = file.read(RECORDING_FILE_LIMIT + 1)
        text = io.TextIOWrapper(io.BytesIO(content), encoding="utf-8-sig").read()
    except OSError as error:
        raise BadInput(f"{path}: cannot be read: {reason_of(error)}") from error
    except UnicodeDecodeError as error:
        raise BadInput(f"{path}: byte {error.start} is no text; a text file is expected") from error
    if len(content) > RECORDING_FILE_LIMIT:
        raise BadInput(f"{path}: longer than {RECORDING_FILE_LIMIT >> 20} MB; recorded motion is expected")
    if not text.strip():
        raise BadInput(f"{path}: is empty; recorded motion is expected")
    return text


def number_rows(path: Path, lines: Sequence[str], columns: int, first_line: int = 1) -> NDArray[np.float64]:
    """(len(lines), columns) finite numbers; first_line: the number in the file of the first of `lines`."""
    try:
        # Fast for valid files; the search for the defect below is slow.
        table = np.array([line.split() for line in lines], dtype=np.float64)
        if table.shape == (len(lines), columns) and (np.abs(table) <= LARGEST).all():
            return table
    except ValueError:
        pass
    rows = [_row(line, columns, f"{path}: line {number}") for number, line in enumerate(lines, first_line)]
    return np.array(rows, dtype=np.float64).reshape(-1, columns)


def finite_number(text: str, place: str) -> float:
    """`text` as a finite number; the error begins with `place`."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not abs(number) <= LARGEST:
        raise BadInput(f"{place}: {shown(text)}: a finite number is expected")
    return number


def whole_number(text: str, place: str) -> int:
    """`text` as a whole number of at most nine digits, not negative; the error begins with `place`."""
    if not (text.isascii() and text.isdecimal() and len(text) <= 9):
        raise BadInput(f"{place}: {shown(text)}: a whole number is expected")
    return int(text)


def rate_from(step: float) -> float:
    """The rate in Hz of frames `step` seconds apart, to six digits: files round 1/30 s to 0.03333334."""
    return float(f"{1 / step:.6g}")


def shown(text: str) -> str:
    """`text` for an error message, short and on one line, because a broken file may contain anything."""
    return repr(re.sub(r"(?s)(.{40}).+", r"\1...", text))


def _row(line: str, columns: int, place: str) -> list[float]:
    cells = line.split()
    if len(cells) != columns:
        raise BadInput(f"{place}: {plural(len(cells), 'value')}; {plural(columns, 'number')} expected")
    return [finite_number(cell, place) for cell in cells]
