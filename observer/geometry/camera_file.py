"""The camera file (TOML): one calibrated camera's projective matrix and where it came from."""

import json
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, PositiveInt, ValidationError

from common.errors import BadInput, LabanmeshError
from observer.geometry.projection import Floats, oriented


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """One calibrated camera.

    matrix: (3, 4) from metres to pixels, of any scale but zero. image_size_px: (width, height).
    reprojection_error_px: root mean square over the points of the calibration. provenance: how it was calibrated.
    """

    name: str
    matrix: Floats
    image_size_px: tuple[int, int] | None = None
    reprojection_error_px: float | None = None
    provenance: str = ""


def read_camera(path: Path) -> Camera:
    """The camera in a file; raises BadInput with file and key when it cannot be read or is no camera."""
    try:
        keys = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror}; a camera file comes from labanmesh calibrate") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadInput(f"{path}: no TOML: {error}") from None
    return _checked(path, keys)


def write_camera(path: Path, camera: Camera) -> None:
    """Write the file whole or not at all; raises BadInput for what is no camera, LabanmeshError for a full disk."""
    text = _toml(camera)
    _checked(path, tomllib.loads(text))
    partial = path.with_name(f"{path.name}.part")
    try:
        partial.write_text(text, encoding="utf-8")
        partial.replace(path)
    except OSError as error:
        raise LabanmeshError(f"{path}: cannot be written: {error.strerror}") from None
    finally:
        partial.unlink(missing_ok=True)


Row = Annotated[list[FiniteFloat], Field(min_length=4, max_length=4)]


class _Keys(BaseModel):
    """The keys of a camera file."""

    model_config = ConfigDict(extra="forbid")
    name: str = Field(min_length=1)
    projective_matrix: Annotated[list[Row], Field(min_length=3, max_length=3)]
    image_size_px: tuple[PositiveInt, PositiveInt] | None = None
    reprojection_error_px: Annotated[FiniteFloat, Field(ge=0)] | None = None
    provenance: str = ""


def _checked(path: Path, keys: dict[str, object]) -> Camera:
    try:
        known = _Keys.model_validate(keys)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"]))
        names = ", ".join(_Keys.model_fields)
        raise BadInput(f"{path}: {key}: {first['msg']}; the keys of a camera file: {names}") from None
    matrix = np.array(known.projective_matrix)
    if np.linalg.matrix_rank(matrix) < 3 or not oriented(matrix).any():
        raise BadInput(f"{path}: projective_matrix: no camera, its rows depend on each other; calibrate again")
    return Camera(known.name, matrix, known.image_size_px, known.reprojection_error_px, known.provenance)


def _toml(camera: Camera) -> str:
    rows = "".join(f"    [{', '.join(map(repr, row))}],\n" for row in camera.matrix.tolist())
    lines = [f"name = {_quoted(camera.name)}", f"projective_matrix = [\n{rows}]"]
    if camera.image_size_px is not None:
        lines.append(f"image_size_px = {list(camera.image_size_px)}")
    if camera.reprojection_error_px is not None:
        lines.append(f"reprojection_error_px = {float(camera.reprojection_error_px)!r}")
    lines.append(f"provenance = {_quoted(camera.provenance)}")
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    # A JSON string is a TOML string, except that TOML also wants DEL escaped and knows no surrogate pairs.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
