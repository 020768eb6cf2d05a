"""Calibration boards, the pictures of them (a video, a picture or a folder), and the annotated picture of a result."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from common.errors import BadInput
from observer.camera.files import PICTURES, PictureFolder, Video
from observer.files import toml_of
from observer.tracks import Floats, Picture

BOARD_FORMS = (
    "chessboard:COLUMNSxROWS:METRES (corners inside the board, e.g. chessboard:4x7:0.06) or a ChArUco file (.toml)"
)


@dataclass(frozen=True, slots=True)
class Chessboard:
    """A chessboard. columns, rows: inner corners, where four squares meet. square: edge length in metres."""

    columns: int
    rows: int
    square: float

    @property
    def points(self) -> Floats:
        """(columns * rows, 3) metres on the board, row by row: x along a row, y down the rows, z 0 (into the board)."""
        return _grid(self.columns, self.rows, self.square)

    @property
    def turned_looks_alike(self) -> bool:
        """Whether the board looks the same upside down, so that its corners are ambiguous."""
        return (self.columns + self.rows) % 2 == 0


@dataclass(frozen=True, slots=True)
class Charuco:
    """A ChArUco board. columns, rows: squares. square, marker: edge lengths in metres.

    dictionary: OpenCV's name, e.g. DICT_4X4_1000. inverted: black and white exchanged. legacy: pattern of OpenCV before
    4.6 with an even number of rows.
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
        """((columns - 1) * (rows - 1), 3) metres on the board by corner id, z 0; the origin is the outer corner."""
        corner = np.array([self.square, self.square, 0.0])
        from_corner: Floats = _grid(self.columns - 1, self.rows - 1, self.square) + corner
        return from_corner

    @property
    def turned_looks_alike(self) -> bool:
        """Never: each marker carries its id."""
        return False


Board = Chessboard | Charuco
MOST_CORNERS = 100


def parse_chessboard(text: str) -> Chessboard:
    """`chessboard:4x7:0.06` -> 4 by 7 corners, squares of 6 cm; raises BadInput for anything else."""
    match = re.fullmatch(r"chessboard:(\d+)x(\d+):([\d.]+)", text.strip())
    try:
        columns, rows, square = int(match[1]), int(match[2]), float(match[3])  # type: ignore[index]
    except (TypeError, ValueError):
        raise BadInput(f"--board {text!r}: not a board; known: {BOARD_FORMS}") from None
    if min(columns, rows) < 3 or max(columns, rows) > MOST_CORNERS:
        wanted = f"at least 3x3 are needed, and at most {MOST_CORNERS}x{MOST_CORNERS} known"
        raise BadInput(f"--board {text[:40]!r}: {str(columns)[:9]}x{str(rows)[:9]} inner corners; {wanted}")
    if not 0.001 <= square <= 2:
        raise BadInput(f"--board {text!r}: squares of {square:g} m; 0.001 to 2 m is expected; the unit is metres")
    return Chessboard(columns, rows, square)


def _grid(columns: int, rows: int, square: float) -> Floats:
    y, x = np.divmod(np.arange(columns * rows), columns)
    return np.column_stack([x * square, y * square, np.zeros(columns * rows)])


CM_PER_UNIT = {"inch": 2.54, "cm": 1.0, "mm": 0.1, "m": 100.0}


class _BoardFileKeys(BaseModel):
    """columns, rows: squares. Without the size of a square, the largest that fits on the board is assumed."""

    model_config = ConfigDict(extra="forbid")
    columns: Annotated[int, Field(ge=3, le=100)]
    rows: Annotated[int, Field(ge=3, le=100)]
    board_height: Annotated[FiniteFloat, Field(gt=0)] | None = None
    board_width: Annotated[FiniteFloat, Field(gt=0)] | None = None
    units: str = "inch"
    dictionary: str
    aruco_scale: Annotated[float, Field(gt=0, lt=1)] = 0.75
    square_size_override_cm: Annotated[FiniteFloat, Field(gt=0, le=200)] | None = None
    inverted: bool = False
    legacy_pattern: bool = False


def read_board(text: str) -> Board:
    """`chessboard:4x7:0.06` or the path of a ChArUco file; raises BadInput naming what is wrong and what is known."""
    if not text.strip().endswith(".toml"):
        return parse_chessboard(text)
    path = Path(text.strip())
    table = toml_of(path, f"known boards: {BOARD_FORMS}")
    try:
        keys = _BoardFileKeys.model_validate(table)
    except ValidationError as error:
        first = error.errors()[0]
        key, names = ".".join(map(str, first["loc"])), ", ".join(_BoardFileKeys.model_fields)
        raise BadInput(f"{path}: {key}: {first['msg']}; the keys of a ChArUco file: {names}") from None
    square = _square_cm(path, keys) / 100
    marker = square * keys.aruco_scale
    return Charuco(keys.columns, keys.rows, square, marker, keys.dictionary, keys.inverted, keys.legacy_pattern)


def _square_cm(path: Path, keys: _BoardFileKeys) -> float:
    if keys.square_size_override_cm is not None:
        return keys.square_size_override_cm
    if keys.board_height is None or keys.board_width is None:
        raise BadInput(f"{path}: no size; add square_size_override_cm, the measured edge of a printed square")
    if keys.units not in CM_PER_UNIT:
        raise BadInput(f"{path}: units = {keys.units!r}: unknown unit; known: {', '.join(CM_PER_UNIT)}")
    return min(keys.board_height / keys.rows, keys.board_width / keys.columns) * CM_PER_UNIT[keys.units]


def pictures(source: Path, every: int = 1) -> Iterator[tuple[int, str, Picture]]:
    """Number from 0, label and (H, W, 3) BGR of each `every`-th picture; raises BadInput for an unreadable source."""
    if not source.exists():
        raise BadInput(f"{source}: no such file; give a video, a picture or a folder of pictures for each camera")
    opened = Video.open(source) if is_video(source) else PictureFolder.open(source)
    for each in opened.played(lambda number: number % every > 0):
        if each.number % every == 0:
            label = f"frame {each.number}" if isinstance(opened, Video) else opened.files[each.number].name
            yield each.number, label, each.picture


def is_video(source: Path) -> bool:
    """Whether the source is a video, whose pictures follow each other closely."""
    return not source.is_dir() and source.suffix.lower() not in PICTURES


DETECTED, PROJECTED, TEXT = (80, 220, 0), (0, 0, 255), (255, 255, 255)
"""Green rings, red crosses, white text (BGR)."""


def annotated(picture: Picture, detected: Floats, projected: Floats, text: str) -> Picture:
    """(H, W, 3), (N, 2) detected and (N, 2) projected corners -> a copy with rings, crosses and a line of text."""
    result = picture.copy()
    size = max(4, picture.shape[1] // 160)
    for u, v in np.round(detected).astype(int).tolist():
        cv2.circle(result, (u, v), size, DETECTED, 2, cv2.LINE_AA)
    for u, v in np.round(projected[np.isfinite(projected).all(axis=1)]).astype(int).tolist():
        cv2.drawMarker(result, (u, v), PROJECTED, cv2.MARKER_CROSS, size, 1, cv2.LINE_AA)
    scale = max(0.5, picture.shape[1] / 1600)
    for colour, width in (((0, 0, 0), 4), (TEXT, 1)):
        cv2.putText(result, text, (10, int(40 * scale)), cv2.FONT_HERSHEY_SIMPLEX, scale, colour, width, cv2.LINE_AA)
    return result
