"""Calibration boards: what is printed on them, and where their corners lie."""

import re
from dataclasses import dataclass

import numpy as np

from common.errors import BadInput
from observer.geometry.projection import Floats

KNOWN = "chessboard:COLUMNSxROWS:METRES (corners inside the board, e.g. chessboard:4x7:0.06) or a ChArUco file (.toml)"


@dataclass(frozen=True, slots=True)
class Chessboard:
    """columns, rows: the corners inside the board where four squares meet. square: edge length in metres."""

    columns: int
    rows: int
    square: float

    @property
    def points(self) -> Floats:
        """(columns * rows, 3) metres on the board, row by row: x along a row, y down the rows, z 0 (into the board)."""
        return _grid(self.columns, self.rows, self.square)

    @property
    def turned_looks_alike(self) -> bool:
        """Whether the board looks the same upside down, so that its corners cannot be told apart."""
        return (self.columns + self.rows) % 2 == 0


@dataclass(frozen=True, slots=True)
class Charuco:
    """columns, rows: squares. square, marker: edge lengths in metres. dictionary: OpenCV's name, e.g. DICT_4X4_1000.

    inverted: white and black are exchanged. legacy: printed by OpenCV before 4.6 with an even number of rows.
    """

    columns: int
    rows: int
    square: float
    marker: float
    dictionary: str
    inverted: bool = False
    legacy: bool = False

    @property
    def points(self) -> Floats:
        """((columns - 1) * (rows - 1), 3) metres on the board, by corner id, z 0; the board's own corner is 0."""
        corner = np.array([self.square, self.square, 0.0])
        from_corner: Floats = _grid(self.columns - 1, self.rows - 1, self.square) + corner
        return from_corner

    @property
    def turned_looks_alike(self) -> bool:
        """Never: each marker says which it is."""
        return False


Board = Chessboard | Charuco


def parse_chessboard(text: str) -> Chessboard:
    """`chessboard:4x7:0.06` -> 4 by 7 corners, squares of 6 cm; raises BadInput for anything else."""
    found = re.fullmatch(r"chessboard:(\d+)x(\d+):([\d.]+)", text.strip())
    try:
        columns, rows, square = int(found[1]), int(found[2]), float(found[3])  # type: ignore[index]
    except (TypeError, ValueError):
        raise BadInput(f"--board {text!r}: no board; known: {KNOWN}") from None
    if min(columns, rows) < 3:
        raise BadInput(f"--board {text!r}: {columns}x{rows} corners; 3x3 are the fewest, count where four squares meet")
    if not 0.001 <= square <= 2:
        raise BadInput(f"--board {text!r}: squares of {square:g} m; 0.001 to 2 m are believed, the unit is metres")
    return Chessboard(columns, rows, square)


def _grid(columns: int, rows: int, square: float) -> Floats:
    y, x = np.divmod(np.arange(columns * rows), columns)
    return np.column_stack([x * square, y * square, np.zeros(columns * rows)])
