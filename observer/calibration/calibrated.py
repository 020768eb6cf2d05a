"""A calibrated camera, and other programs' files: OpenCV-style TOML (Pose2Sim, caliscope, anipose), Qualisys."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from common.errors import BadInput, reason_of
from common.files import read_text
from common.text import plural
from observer.files import toml_of, write_file
from observer.geometry.projection import (
    DISTORTION_SIZES,
    DISTORTION_SIZES_TEXT,
    LensDistortion,
    check_intrinsic_matrix,
    distorted,
    project,
)
from observer.tracks import Floats


@dataclass(frozen=True, slots=True, eq=False)
class CalibratedCamera:
    """One camera.

    K: (3, 3) intrinsic matrix, px. distortion: (4, 5 or 8) in OpenCV's order, or (0,) where unknown. R: (3, 3),
    t: (3,) metres: extrinsics, X_camera = R X_room + t. image_size_px: (width, height), where known. error_px: root
    mean square reprojection error, where known. provenance: how it was calibrated.
    """

    name: str
    K: Floats
    distortion: Floats
    R: Floats
    t: Floats
    image_size_px: tuple[int, int] | None = None
    error_px: float | None = None
    provenance: str = ""

    @property
    def matrix(self) -> Floats:
        """(3, 4) K [R | t]: metres to undistorted pixels; w is the depth in metres."""
        return self.K @ np.column_stack([self.R, self.t])

    @property
    def lens(self) -> LensDistortion | None:
        """The lens for the camera file; None where the distortion is unknown."""
        return LensDistortion(self.K, self.distortion) if len(self.distortion) else None

    @property
    def position(self) -> Floats:
        """(3,) position of the camera in the room, metres."""
        return -self.R.T @ self.t

    def pixels(self, points: Floats) -> Floats:
        """(..., 3) metres -> (..., 2) pixels with distortion; NaN for points behind the camera."""
        normalised = distorted(project(np.column_stack([self.R, self.t]), points), self.distortion)
        return normalised @ self.K[:2, :2].T + self.K[:2, 2]

    def moved(self, R: Floats, t: Floats) -> "CalibratedCamera":
        """The same camera in a room whose points are X' = R X + t."""
        R_new = self.R @ R.T
        return replace(self, R=R_new, t=self.t - R_new @ t)


def rotation(values: Sequence[object], what: str) -> Floats:
    """(3,) Rodrigues vector or (3, 3) matrix -> (3, 3) rotation; raises BadInput that starts with `what`."""
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.zeros(0)
    if array.shape == (3,) and np.isfinite(array).all():
        from scipy.spatial.transform import Rotation

        return np.asarray(Rotation.from_rotvec(array).as_matrix(), np.float64)
    if array.shape != (3, 3) or not np.allclose(array @ array.T, np.eye(3), atol=1e-3) or np.linalg.det(array) < 0:
        expected = "3 numbers (Rodrigues vector) or an orthogonal 3x3 matrix with determinant 1"
        raise BadInput(f"{what}: not a rotation; expected {expected}")
    left, _, right = np.linalg.svd(array)
    nearest: Floats = left @ right
    return nearest


def angle_between(first: Floats, second: Floats) -> float:
    """Angle between two (3, 3) rotations, 0 to π radians."""
    return float(np.arccos(np.clip((np.trace(first.T @ second) - 1) / 2, -1, 1)))


NEEDED_KEYS = "matrix, rotation, translation"


def read_opencv(path: Path) -> list[CalibratedCamera]:
    """All cameras of a file: one table per camera (Pose2Sim, anipose), or a table `cameras` of them (caliscope).

    Camera 0 of caliscope is named cam_0, like its video.

    matrix 3x3, distortions (or dist, distortion), rotation as Rodrigues vector or 3x3, translation in metres, size.
    Raises BadInput naming file, camera and key.
    """
    keys = toml_of(path, "an OpenCV-style TOML file of cameras is expected")
    tables = keys["cameras"] if isinstance(keys.get("cameras"), dict) else keys
    cameras = [
        _opencv_camera(
            f"{path}: {name}", str(table.get("name", f"cam_{name}" if name.isdigit() else name)), table, path.name
        )
        for name, table in tables.items()
        if isinstance(table, dict) and name != "metadata" and not table.get("ignore")
    ]
    if not cameras:
        raise BadInput(f"{path}: no camera in it; one table per camera is expected, with {NEEDED_KEYS}")
    return cameras


def write_opencv(path: Path, cameras: list[CalibratedCamera]) -> None:
    """Write one table per camera, atomically; raises LabanmeshError when the file cannot be written."""
    text = "\n".join(_toml(number, camera) for number, camera in enumerate(cameras, 1))
    write_file(path, text.encode())


def _opencv_camera(where: str, name: str, table: dict[str, Any], file: str) -> CalibratedCamera:
    missing = [key for key in NEEDED_KEYS.split(", ") if key not in table]
    if missing:
        raise BadInput(f"{where}.{missing[0]}: missing; a camera has {NEEDED_KEYS}, and often distortions, size")
    if table.get("fisheye"):
        raise BadInput(f"{where}.fisheye = true: fisheye lenses are not supported; calibrate again without")
    K = _numbers(f"{where}.matrix", table["matrix"], (3, 3))
    check_intrinsic_matrix(K, f"{where}.matrix: ")
    coefficients: object = next((table[key] for key in ("distortions", "distortion", "dist") if key in table), [])
    distortion = _numbers(f"{where}.distortions", coefficients, None).ravel()
    if len(distortion) not in (0, *DISTORTION_SIZES):
        raise BadInput(f"{where}.distortions: {plural(len(distortion), 'number')}; expected {DISTORTION_SIZES_TEXT}")
    t = _numbers(f"{where}.translation", table["translation"], None).ravel()
    if len(t) != 3:
        raise BadInput(f"{where}.translation: {plural(len(t), 'number')}; x, y and z in metres are needed")
    R = rotation(table["rotation"] if isinstance(table["rotation"], list) else [], f"{where}.rotation")
    size = _size(f"{where}.size", table["size"]) if "size" in table else None
    error = table.get("error")
    error_px = float(error) if isinstance(error, int | float) and np.isfinite(error) and error >= 0 else None
    return CalibratedCamera(name, K, distortion, R, t, size, error_px, f"read from {file}")


def _numbers(where: str, values: object, shape: tuple[int, ...] | None) -> Floats:
    try:
        numbers = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.array([np.nan])
    if not np.isfinite(numbers).all() or (shape is not None and numbers.shape != shape):
        raise BadInput(f"{where}: {'x'.join(map(str, shape)) if shape else 'a list of'} finite numbers are needed")
    return numbers


def _size(where: str, values: object) -> tuple[int, int]:
    size = _numbers(where, values, (2,))
    if (size < 1).any():
        raise BadInput(f"{where}: {values}: width and height in pixels are needed")
    return int(size[0]), int(size[1])


def _toml(number: int, camera: CalibratedCamera) -> str:
    lines = [f"[cam_{number}]", f"name = {json.dumps(camera.name, ensure_ascii=False)}"]
    if camera.image_size_px is not None:
        lines.append(f"size = {list(camera.image_size_px)}")
    values = {"matrix": camera.K, "distortions": camera.distortion, "rotation": camera.R, "translation": camera.t}
    lines += [f"{key} = {value.tolist()}" for key, value in values.items()]
    if camera.error_px is not None:
        lines.append(f"error = {float(camera.error_px)!r}")
    return "\n".join([*lines, "fisheye = false"]) + "\n"


SUBPIXELS = 64.0
"""Focal lengths and principal points are stored in 64ths of a pixel."""
MM_PER_METRE = 1000.0


def read_qualisys(path: Path) -> list[CalibratedCamera]:
    """All active cameras of a .qca.txt, with z up as in Qualisys; raises BadInput naming file and attribute.

    Its cameras look along -z with y up, ours along z with y down: a half turn about x.
    """
    try:
        text = read_text(path)
    except OSError as error:
        raise BadInput(
            f"cannot read {path}: {reason_of(error)}; a Qualisys calibration (.qca.txt) is expected"
        ) from None
    except ValueError as error:
        raise BadInput(f"{path}: {error}; a Qualisys calibration (.qca.txt) is expected") from None
    if "<!ENTITY" in text:
        raise BadInput(f"{path}: declares XML entities, which no calibration needs; export it again")
    try:
        root = ElementTree.fromstring(text)  # noqa: S314 - entities are rejected above
    except ElementTree.ParseError as error:
        raise BadInput(f"{path}: not a Qualisys calibration: {error}") from None
    cameras = [_qualisys_camera(path, camera) for camera in root.iter("camera") if camera.get("active", "1") == "1"]
    if not cameras:
        raise BadInput(f"{path}: no active camera in it; a Qualisys calibration (.qca.txt) is expected")
    return cameras


def _qualisys_camera(path: Path, camera: ElementTree.Element) -> CalibratedCamera:
    name = camera.get("serial", "")
    where = f"{path}: camera {name!r}"
    if not name:
        raise BadInput(f"{where}: no serial number, which names the camera")
    if camera.get("viewrotation", "0") not in ("", "0"):
        raise BadInput(
            f"{where}: viewrotation = {camera.get('viewrotation')}: rotated pictures are not supported; export with 0"
        )
    parts = {tag: _part(where, camera, tag) for tag in ("fov_video", "transform", "intrinsic")}
    area, transform, lens = parts["fov_video"], parts["transform"], parts["intrinsic"]
    # The rows of the matrix are the camera's axes in the room: right, up, and backward.
    axes = [[_number(where, transform, f"r{row}{column}") for column in (1, 2, 3)] for row in (1, 2, 3)]
    R = np.diag([1.0, -1.0, -1.0]) @ rotation(axes, f"{where}: transform")
    position = np.array([_number(where, transform, axis) for axis in "xyz"]) / MM_PER_METRE
    left, top = _number(where, area, "left"), _number(where, area, "top")
    focal = [_number(where, lens, f"focalLength{axis}") / SUBPIXELS for axis in "UV"]
    centre = [_number(where, lens, f"centerPoint{axis}") / SUBPIXELS for axis in "UV"]
    skew = _number(where, lens, "skew") / SUBPIXELS
    K = np.array([[focal[0], skew, centre[0] - left], [0, focal[1], centre[1] - top], [0, 0, 1.0]])
    names = ("radialDistortion1", "radialDistortion2", "tangentalDistortion1", "tangentalDistortion2")
    distortion = np.array([_number(where, lens, key) for key in (*names, "radialDistortion3")])
    size = (int(_number(where, area, "right") - left) + 1, int(_number(where, area, "bottom") - top) + 1)
    return CalibratedCamera(name, K, distortion, R, -R @ position, size, None, f"read from {path.name}")


def _part(where: str, camera: ElementTree.Element, tag: str) -> ElementTree.Element:
    part = camera.find(tag)
    if part is None:
        raise BadInput(f"{where}: no {tag}; a camera has fov_video, transform and intrinsic")
    return part


def _number(where: str, part: ElementTree.Element, key: str) -> float:
    try:
        value = float(part.get(key, ""))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise BadInput(f"{where}: {part.tag} {key} = {part.get(key)!r}: a number is needed")
    return value
