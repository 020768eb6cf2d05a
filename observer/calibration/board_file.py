"""The ChArUco file (TOML) as caliscope writes it, read into a board."""

import tomllib
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from common.errors import BadInput
from observer.calibration.board import KNOWN, Board, Charuco, parse_chessboard

CM_PER_UNIT = {"inch": 2.54, "cm": 1.0, "mm": 0.1, "m": 100.0}


class _Keys(BaseModel):
    """columns, rows: squares. The printed square's size counts when it is given, else what fits on the board."""

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
    try:
        keys = _Keys.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror}; known boards: {KNOWN}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadInput(f"{path}: no TOML: {error}") from None
    except ValidationError as error:
        first = error.errors()[0]
        key, names = ".".join(map(str, first["loc"])), ", ".join(_Keys.model_fields)
        raise BadInput(f"{path}: {key}: {first['msg']}; the keys of a ChArUco file: {names}") from None
    square = _square_cm(path, keys) / 100
    marker = square * keys.aruco_scale
    return Charuco(keys.columns, keys.rows, square, marker, keys.dictionary, keys.inverted, keys.legacy_pattern)


def _square_cm(path: Path, keys: _Keys) -> float:
    if keys.square_size_override_cm is not None:
        return keys.square_size_override_cm
    if keys.board_height is None or keys.board_width is None:
        raise BadInput(f"{path}: no size; give square_size_override_cm, the edge of a printed square, measured")
    if keys.units not in CM_PER_UNIT:
        raise BadInput(f"{path}: units = {keys.units!r}: unknown unit; known: {', '.join(CM_PER_UNIT)}")
    return min(keys.board_height / keys.rows, keys.board_width / keys.columns) * CM_PER_UNIT[keys.units]
