"""Qualisys calibration (.qca.txt), read into cameras: millimetres, z up, pixels in 64ths."""

import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from common.errors import BadInput
from observer.calibration.calibrated import Calibrated, rotation

SUBPIXELS = 64.0
"""Focal lengths and centres are given in 64ths of a pixel."""

MM_PER_METRE = 1000.0


def read_qualisys(path: Path) -> list[Calibrated]:
    """All active cameras of a .qca.txt, the room's z up as Qualisys has it; raises BadInput naming file and attribute.

    Its camera looks along -z with y up, ours along z with y down: a half turn about x.
    """
    try:
        text = path.read_bytes()
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror}; a Qualisys calibration (.qca.txt) is expected") from None
    if b"<!ENTITY" in text:
        raise BadInput(f"{path}: declares XML entities, which no calibration does; export it again")
    try:
        root = ElementTree.fromstring(text)  # noqa: S314 - entities are refused above
    except ElementTree.ParseError as error:
        raise BadInput(f"{path}: no Qualisys calibration: {error}") from None
    cameras = [_camera(path, camera) for camera in root.iter("camera") if camera.get("active", "1") == "1"]
    if not cameras:
        raise BadInput(f"{path}: no active camera in it; a Qualisys calibration (.qca.txt) is expected")
    return cameras


def _camera(path: Path, camera: ElementTree.Element) -> Calibrated:
    name = camera.get("serial", "")
    where = f"{path}: camera {name!r}"
    if not name:
        raise BadInput(f"{where}: no serial; it names the camera")
    if camera.get("viewrotation", "0") not in ("", "0"):
        raise BadInput(
            f"{where}: viewrotation = {camera.get('viewrotation')}: turned pictures are not read; export at 0"
        )
    parts = {tag: _part(where, camera, tag) for tag in ("fov_video", "transform", "intrinsic")}
    area, place, lens = parts["fov_video"], parts["transform"], parts["intrinsic"]
    # The rows of the file's matrix are the camera's axes in the room: right, up, and back from where it looks.
    axes = [[_number(where, place, f"r{row}{column}") for column in (1, 2, 3)] for row in (1, 2, 3)]
    R = np.diag([1.0, -1.0, -1.0]) @ rotation(axes, f"{where}: transform")
    stands = np.array([_number(where, place, axis) for axis in "xyz"]) / MM_PER_METRE
    left, top = _number(where, area, "left"), _number(where, area, "top")
    focal = [_number(where, lens, f"focalLength{axis}") / SUBPIXELS for axis in "UV"]
    centre = [_number(where, lens, f"centerPoint{axis}") / SUBPIXELS for axis in "UV"]
    skew = _number(where, lens, "skew") / SUBPIXELS
    K = np.array([[focal[0], skew, centre[0] - left], [0, focal[1], centre[1] - top], [0, 0, 1.0]])
    names = ("radialDistortion1", "radialDistortion2", "tangentalDistortion1", "tangentalDistortion2")
    distortion = np.array([_number(where, lens, key) for key in (*names, "radialDistortion3")])
    size = (int(_number(where, area, "right") - left) + 1, int(_number(where, area, "bottom") - top) + 1)
    return Calibrated(name, K, distortion, R, -R @ stands, size, None, f"read from {path.name}")


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
