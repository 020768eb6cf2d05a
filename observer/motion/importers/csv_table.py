"""Imports plain tables: .csv files with one row per frame (docs/reference/motion.md).

The first line names subject, trial, label, frame, time_s, and x, y and z of each body part. Rows of one recording stand
together; `frame` counts up by one, and `time_s` grows by equal steps, within 1 %.
"""

import csv
import io
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from common.text import plural
from observer.motion.archive import ARCHIVE_LABEL_RULE, MotionArchive, Recording, check_recording, clean_label, is_label
from observer.motion.importers.base import (
    ImportResult,
    Progress,
    counted,
    files_at,
    finite_number,
    rate_from,
    read_text,
    require_same_parts,
    whole_number,
)
from observer.tracks import BODY_PARTS

_KEY_COLUMNS = ("subject", "trial", "label", "frame", "time_s")

_REGULAR = 0.01
"""How far a step of time_s may be from the recording's mean step, as a share of it."""

Row = tuple[int, list[str]]
"""The line's number in the file, and its cells."""


def header_of(body_parts: tuple[str, ...]) -> tuple[str, ...]:
    """The columns of a table of these parts, in their order."""
    return _KEY_COLUMNS + tuple(f"{part}_{axis}" for part in body_parts for axis in "xyz")


def import_files(path: Path, progress: Progress | None = None) -> ImportResult:
    """The table `path`, or every .csv file in this folder (or just below it).

    Raises BadInput with the line for a wrong header, a cell that is neither empty nor a finite number, a label that
    cannot be one, frames that are missing, irregular time, or rows of one recording that stand apart.
    """
    files = files_at(path, "*.[cC][sS][vV]", ".csv files")
    tables: list[MotionArchive] = []
    for file in counted(files, len(files), progress):
        tables.append(_table(file))
        require_same_parts(file, tables[-1].body_parts, files[0], tables[0].body_parts)
    return ImportResult(MotionArchive(tables[0].body_parts, tuple(r for table in tables for r in table.recordings)))


def _table(file: Path) -> MotionArchive:
    parts, lines = _lines(file)
    first_lines: dict[tuple[str, ...], int] = {}
    recordings = []
    for key, group in groupby(lines, key=lambda row: tuple(row[1][:3])):
        rows = list(group)
        line = rows[0][0]
        if first_lines.setdefault(key, line) != line:
            raise BadInput(
                f"{file}: line {line}: subject {key[0]!r}, trial {key[1]!r}, label {key[2]!r} began on line "
                f"{first_lines[key]}: the rows of a recording are expected together"
            )
        recordings.append(_recording(file, rows, parts))
    if not recordings:
        raise BadInput(f"{file}: no rows under the header; one a frame is expected")
    return MotionArchive(parts, tuple(recordings))


def _lines(file: Path) -> tuple[tuple[str, ...], list[Row]]:
    """The body parts, and the rows under the header, each of the right width."""
    rows = []
    reader = csv.reader(io.StringIO(read_text(file), newline=""), strict=True)
    try:
        header = tuple(cell.strip() for cell in next(reader, []))
        parts = tuple(name.removesuffix("_x") for name in header[len(_KEY_COLUMNS) :: 3])
        if header != header_of(parts) or not parts:
            raise BadInput(f"{file}: line 1: the header is expected: {','.join(header_of(BODY_PARTS))}, or other parts")
        for cells in filter(None, reader):
            if len(cells) != len(header):
                raise BadInput(
                    f"{file}: line {reader.line_num}: {plural(len(cells), 'cell')}; {len(header)} are expected"
                )
            rows.append((reader.line_num, [cell.strip() for cell in cells]))
    except csv.Error as error:
        raise BadInput(f"{file}: line {reader.line_num}: {error}; cells with commas between are expected") from error
    return parts, rows


def _recording(file: Path, rows: list[Row], parts: tuple[str, ...]) -> Recording:
    line, (subject, trial, label, *_) = rows[0]
    if not subject or not trial:
        raise BadInput(f"{file}: line {line}: subject {subject!r}, trial {trial!r}: both are expected")
    if not is_label(label):
        raise BadInput(
            f"{file}: line {line}: label {label!r}: {ARCHIVE_LABEL_RULE}, such as {clean_label(label) or 'wave'}"
        )
    if len(rows) < 2:
        raise BadInput(f"{file}: line {line}: the only row of its recording; two frames or more are expected")
    _check_frames(file, rows)
    positions = np.array([_positions(file, row, parts) for row in rows], dtype=np.float32)
    recording = Recording(positions, _rate_hz(file, rows), label, subject, trial)
    check_recording(recording, len(parts), f"{file}: lines {line} to {rows[-1][0]}")
    return recording


def _check_frames(file: Path, rows: list[Row]) -> None:
    column = _KEY_COLUMNS.index("frame")
    before: int | None = None
    for line, cells in rows:
        frame = whole_number(cells[column], f"{file}: line {line}: frame")
        if before is not None and frame != before + 1:
            raise BadInput(f"{file}: line {line}: frame {frame}: {before + 1} is expected; not seen is empty cells")
        before = frame


def _rate_hz(file: Path, rows: list[Row]) -> float:
    column = _KEY_COLUMNS.index("time_s")
    times = np.array([finite_number(cells[column], f"{file}: line {line}: time_s") for line, cells in rows])
    steps = np.diff(times)
    mean = float(steps.mean())
    off = np.abs(steps - mean) > _REGULAR * abs(mean) + 1e-12
    worst = int(off.argmax()) if off.any() else int(steps.argmin())
    if off.any() or mean <= 0:
        raise BadInput(
            f"{file}: line {rows[worst + 1][0]}: time_s grows by {steps[worst]:.6g}: "
            f"equal steps above 0 are expected, within 1 % of their mean, {mean:.6g}"
        )
    return rate_from(mean)


def _positions(file: Path, row: Row, parts: tuple[str, ...]) -> NDArray[np.float64]:
    """(P, 3) one frame's body parts, NaN where not seen."""
    line, cells = row
    numbers = [
        finite_number(cell, f"{file}: line {line}: {name}") if cell else np.nan
        for name, cell in zip(header_of(parts)[len(_KEY_COLUMNS) :], cells[len(_KEY_COLUMNS) :], strict=True)
    ]
    frame = np.array(numbers).reshape(len(parts), 3)
    for part, place in zip(parts, frame, strict=True):
        if np.isnan(place).any() and not np.isnan(place).all():
            raise BadInput(f"{file}: line {line}: {part}: three coordinates are expected, or three empty cells")
    return frame
