"""The camera file (TOML): projective matrix, lens and provenance of one calibrated camera."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from common.errors import BadInput
from common.files import parse_toml
from common.text import plural
from observer.files import toml_of, write_file
from observer.geometry.projection import (
    DISTORTION_SIZES,
    DISTORTION_SIZES_TEXT,
    LensDistortion,
    check_intrinsic_matrix,
    oriented,
)
from observer.tracks import Floats

ORTHOGONAL = 1e-3
"""Tolerance for the rotation that the intrinsic matrix leaves: files hold rounded numbers."""


@dataclass(frozen=True, slots=True, eq=False)
class CameraModel:
    """One calibrated camera.

    matrix: (3, 4) from metres to undistorted pixels, of any scale but zero. image_size_px: (width, height).
    reprojection_error_px: root mean square over the points of the calibration. provenance: how it was calibrated.
    lens: from undistorted pixels to those of the picture, where known.
    """

    name: str
    matrix: Floats
    image_size_px: tuple[int, int] | None = None
    reprojection_error_px: float | None = None
    provenance: str = ""
    lens: LensDistortion | None = None


def read_camera(path: Path) -> CameraModel:
    """The camera in a file; raises BadInput naming file and key when it is unreadable or not a camera."""
    return _checked(path, toml_of(path, "labanmesh camera calibrate writes camera files"))


def write_camera(path: Path, camera: CameraModel) -> None:
    """Write the file atomically; raises BadInput for an invalid camera, LabanmeshError when it cannot be written."""
    text = _toml(camera)
    _checked(path, parse_toml(text))
    write_file(path, text.encode())


Number = Annotated[FiniteFloat, Field(ge=-1e30, le=1e30)]
Side = Annotated[int, Field(ge=1, le=16_384)]
"""Of a picture, px."""
Row = Annotated[list[Number], Field(min_length=4, max_length=4)]
RowOfThree = Annotated[list[Number], Field(min_length=3, max_length=3)]


class _CameraFileKeys(BaseModel):
    """The keys of a camera file."""

    model_config = ConfigDict(extra="forbid")
    name: str = Field(min_length=1)
    projective_matrix: Annotated[list[Row], Field(min_length=3, max_length=3)]
    image_size_px: tuple[Side, Side] | None = None
    reprojection_error_px: Annotated[FiniteFloat, Field(ge=0)] | None = None
    provenance: str = ""
    intrinsic_matrix: Annotated[list[RowOfThree], Field(min_length=3, max_length=3)] | None = None
    distortion: list[Number] | None = None


def _checked(path: Path, keys: dict[str, object]) -> CameraModel:
    try:
        known = _CameraFileKeys.model_validate(keys)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"]))
        names = ", ".join(_CameraFileKeys.model_fields)
        raise BadInput(f"{path}: {key}: {first['msg']}; the keys of a camera file: {names}") from None
    matrix = np.array(known.projective_matrix)
    if np.linalg.matrix_rank(matrix) < 3 or not oriented(matrix).any():
        raise BadInput(f"{path}: projective_matrix: not a camera: its rows are linearly dependent; calibrate again")
    lens = _lens(path, known, matrix)
    return CameraModel(known.name, matrix, known.image_size_px, known.reprojection_error_px, known.provenance, lens)


def _lens(path: Path, known: _CameraFileKeys, matrix: Floats) -> LensDistortion | None:
    if known.intrinsic_matrix is None and known.distortion is None:
        return None
    if known.intrinsic_matrix is None or known.distortion is None:
        present, missing = ("distortion", "intrinsic_matrix")[:: 1 if known.distortion is not None else -1]
        raise BadInput(f"{path}: {present} without {missing}: a lens has both; omit both where it is unknown")
    K, distortion = np.array(known.intrinsic_matrix), np.array(known.distortion)
    if len(distortion) not in DISTORTION_SIZES:
        raise BadInput(f"{path}: distortion: {plural(len(distortion), 'number')}; expected {DISTORTION_SIZES_TEXT}")
    check_intrinsic_matrix(K, f"{path}: intrinsic_matrix: ")
    _check_together(path, K, matrix)
    return LensDistortion(K, distortion)


def _check_together(path: Path, K: Floats, matrix: Floats) -> None:
    """Check that the inverse intrinsic matrix times the projective matrix is a rotation of any scale."""
    left = np.linalg.solve(K, oriented(matrix)[:, :3])
    left = left / np.cbrt(np.linalg.det(left))
    if not np.allclose(left @ left.T, np.eye(3), atol=ORTHOGONAL):
        raise BadInput(
            f"{path}: intrinsic_matrix: does not match projective_matrix, which must be intrinsic_matrix [R | t] in "
            "undistorted pixels; calibrate again, or omit intrinsic_matrix and distortion"
        )


def _toml(camera: CameraModel) -> str:
    lines = [f"name = {_quoted(camera.name)}", f"projective_matrix = {_rows(camera.matrix)}"]
    if camera.image_size_px is not None:
        lines.append(f"image_size_px = {list(camera.image_size_px)}")
    if camera.reprojection_error_px is not None:
        lines.append(f"reprojection_error_px = {float(camera.reprojection_error_px)!r}")
    if camera.lens is not None:
        lines.append(f"intrinsic_matrix = {_rows(camera.lens.intrinsic_matrix)}")
        lines.append(f"distortion = {camera.lens.distortion.tolist()}")
    lines.append(f"provenance = {_quoted(camera.provenance)}")
    return "\n".join(lines) + "\n"


def _rows(matrix: Floats) -> str:
    return "[\n" + "".join(f"    {row},\n" for row in matrix.tolist()) + "]"


def _quoted(text: str) -> str:
    # A JSON string is a TOML string, except that TOML requires DEL escaped and has no surrogate pairs.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
