"""OpenCV-style camera TOML, as Pose2Sim, caliscope and anipose write it, read and written."""

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from common.errors import BadInput, LabanmeshError
from observer.calibration.calibrated import Calibrated, rotation
from observer.geometry.lens import DISTORTION_SIZES, SIZES_SAID
from observer.geometry.projection import Floats

NEEDED = "matrix, rotation, translation"


def read_opencv(path: Path) -> list[Calibrated]:
    """All cameras of a file: one table a camera (Pose2Sim, anipose) or a table `cameras` of them (caliscope,
    whose camera 0 is called cam_0, as its video is).

    matrix 3x3, distortions (or dist, distortion), rotation as Rodrigues vector or 3x3, translation in metres, size.
    Raises BadInput naming file, camera and key.
    """
    try:
        keys = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror}; an OpenCV-style TOML file of cameras is expected") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadInput(f"{path}: no TOML: {error}") from None
    tables = keys["cameras"] if isinstance(keys.get("cameras"), dict) else keys
    cameras = [
        _camera(f"{path}: {name}", str(table.get("name", f"cam_{name}" if name.isdigit() else name)), table, path.name)
        for name, table in tables.items()
        if isinstance(table, dict) and name != "metadata" and not table.get("ignore")
    ]
    if not cameras:
        raise BadInput(f"{path}: no camera in it; one table a camera is expected, with {NEEDED}")
    return cameras


def write_opencv(path: Path, cameras: list[Calibrated]) -> None:
    """One table a camera, whole or not at all; raises LabanmeshError when the disk does not take it."""
    text = "\n".join(_toml(number, camera) for number, camera in enumerate(cameras, 1))
    partial = path.with_name(f"{path.name}.part")
    try:
        partial.write_text(text, encoding="utf-8")
        partial.replace(path)
    except OSError as error:
        raise LabanmeshError(f"{path}: cannot be written: {error.strerror}") from None
    finally:
        partial.unlink(missing_ok=True)


def _camera(where: str, name: str, table: dict[str, Any], file: str) -> Calibrated:
    missing = [key for key in NEEDED.split(", ") if key not in table]
    if missing:
        raise BadInput(f"{where}.{missing[0]}: missing; a camera has {NEEDED}, and often distortions, size")
    if table.get("fisheye"):
        raise BadInput(f"{where}.fisheye = true: this lens model is not known; calibrate again without it")
    K = _numbers(f"{where}.matrix", table["matrix"], (3, 3))
    if not (K[0, 0] > 0 and K[1, 1] > 0 and np.allclose(K[2], [0, 0, 1]) and K[1, 0] == 0):
        raise BadInput(f"{where}.matrix: no intrinsic matrix [[fu, s, cu], [0, fv, cv], [0, 0, 1]] with fu, fv above 0")
    bends: object = next((table[key] for key in ("distortions", "distortion", "dist") if key in table), [])
    distortion = _numbers(f"{where}.distortions", bends, None).ravel()
    if len(distortion) not in (0, *DISTORTION_SIZES):
        raise BadInput(f"{where}.distortions: {len(distortion)} numbers; {SIZES_SAID} are known")
    place = _numbers(f"{where}.translation", table["translation"], None).ravel()
    if len(place) != 3:
        raise BadInput(f"{where}.translation: {len(place)} numbers; x, y and z in metres are needed")
    turned = table["rotation"]
    R = rotation(turned if isinstance(turned, list) else [], f"{where}.rotation")
    size = _size(f"{where}.size", table["size"]) if "size" in table else None
    error = table.get("error")
    known = float(error) if isinstance(error, int | float) and np.isfinite(error) and error >= 0 else None
    return Calibrated(name, K, distortion, R, place, size, known, f"read from {file}")


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


def _toml(number: int, camera: Calibrated) -> str:
    lines = [f"[cam_{number}]", f"name = {json.dumps(camera.name, ensure_ascii=False)}"]
    if camera.image_size_px is not None:
        lines.append(f"size = {list(camera.image_size_px)}")
    values = {"matrix": camera.K, "distortions": camera.distortion, "rotation": camera.R, "translation": camera.t}
    lines += [f"{key} = {value.tolist()}" for key, value in values.items()]
    if camera.error_px is not None:
        lines.append(f"error = {float(camera.error_px)!r}")
    return "\n".join([*lines, "fisheye = false"]) + "\n"
