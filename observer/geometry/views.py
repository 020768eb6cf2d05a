"""Views: perspectives by name, a performer who is turned relative to them, and pictures of another size than a view's.

Pictures of another size are rescaled if the shape is the same, and refused if not.
"""

import difflib
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.geometry.camera_file import read_camera
from observer.geometry.projection import LensDistortion, parallel_matrix, picture_right
from observer.tracks import Floats, Size

PRINCIPAL_PLANES_DEG = {"door": (0.0, 0.0), "wheel": (90.0, 0.0), "table": (0.0, 90.0)}
"""Laban's three planes as (yaw, pitch) of a camera that looks at them (section III.A)."""
KNOWN_VIEWS = "door, wheel, table, yaw:DEG, yaw:DEG,pitch:DEG, a camera file (.toml), or camera"
THIS_CAMERA = "camera"
"""The view of a model that was taught from one camera's own tracks; `camera:NAME` also says which camera."""
THIS_CAMERA_MATRIX: Floats = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""(3, 4) the identity in the image: u and v are what the tracker found. No view of 3-D positions has this matrix."""

Real = TypeVar("Real", bound=np.floating)


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A perspective. matrix: (3, 4) projective matrix, to metres for planes and angles, to pixels for a camera file.

    lens: distortion of the camera's pixels, where its file has one; the matrix holds for undistorted pixels. size_px:
    width and height of the pictures whose pixels these are, where the file states them.
    """

    name: str
    matrix: Floats
    lens: LensDistortion | None = None
    size_px: tuple[int, int] | None = None

    @property
    def has_place(self) -> bool:
        """Whether the camera stands at a point in a room, so that it matters where the person stands."""
        return bool(self.matrix[2, :3].any())

    @property
    def is_this_camera(self) -> bool:
        """Whether this is no perspective on 3-D positions, but what one camera saw from wherever it stands."""
        return is_this_camera(self.matrix)


def is_this_camera(matrix: Floats) -> bool:
    """Whether a (3, 4) matrix is that of the view `camera`."""
    return np.array_equal(matrix, THIS_CAMERA_MATRIX)


def this_camera(name: str = "") -> View:
    """The view of one camera's own tracks; name: of the camera, for people."""
    return View(f"{THIS_CAMERA}:{name}" if name else THIS_CAMERA, THIS_CAMERA_MATRIX)


def parse_view(text: str, folder: Path | None = None) -> View:
    """One view by its name; the path of a camera file is relative to `folder`, by default the working directory.

    Raises BadInput for an unknown name, an invalid angle, a pitch outside -90..90 and an invalid camera file.
    """
    text = text.strip()
    kind, colon, camera_name = text.partition(":")
    if kind == THIS_CAMERA and (camera_name or not colon):
        return this_camera(camera_name)
    if text in PRINCIPAL_PLANES_DEG:
        return _parallel_view(text, *PRINCIPAL_PLANES_DEG[text])
    if text.startswith("yaw:"):
        return _angle_view(text)
    if text.endswith(".toml"):
        camera = read_camera((folder or Path()) / text)
        return View(camera.name, camera.matrix, camera.lens, camera.image_size_px)
    raise BadInput(f"view {text!r}: unknown view; {_hint(text)}")


def facing(view: View) -> float:
    """How much the performer faces the camera: 1 seen from the front, 0 from a side, -1 from behind.

    This is minus the x component of the picture's right, which points to the left of a performer who faces the camera:
    the cosine of the camera's yaw. 1 for the view `camera`, whose direction is unknown: people mostly face a camera.
    """
    return 1.0 if view.is_this_camera else -float(picture_right(view.matrix)[0])


def split_views(text: str) -> list[str]:
    """`door,yaw:45,pitch:10` -> [`door`, `yaw:45,pitch:10`]: a pitch belongs to the yaw before it.

    Raises BadInput for an empty name and for a pitch without a yaw.
    """
    views: list[str] = []
    for piece in (raw.strip() for raw in text.split(",")):
        if not piece:
            raise BadInput(f"views {text!r}: a name is missing between commas; e.g. door,wheel")
        if not piece.startswith("pitch:"):
            views.append(piece)
        elif views and views[-1].startswith("yaw:") and "," not in views[-1]:
            views[-1] += f",{piece}"
        else:
            raise BadInput(f"views {text!r}: {piece} needs a yaw before it, e.g. yaw:0,{piece}")
    return views


def turned(positions: NDArray[Real], angle_rad: float, about: NDArray[np.floating] | None = None) -> NDArray[Real]:
    """(..., 3) positions -> (..., 3), the same type: the performer turned about the vertical through `about` (3,).

    A positive angle turns to the performer's left, counter-clockwise seen from above. Turned by a and seen from yaw v
    equals unturned and seen from yaw v + a (for a parallel view up to a shift, none when `about` is the origin).
    about: its height is ignored; by default the mean of the finite points, so that the performer turns in place.
    """
    centre = _mean(positions) if about is None else about
    sin, cos = math.sin(angle_rad), math.cos(angle_rad)
    x, z = positions[..., 0] - centre[0], positions[..., 2] - centre[2]
    result = np.stack([x * cos + z * sin + centre[0], positions[..., 1], z * cos - x * sin + centre[2]], axis=-1)
    return result.astype(positions.dtype)


def _mean(positions: NDArray[np.floating]) -> Floats:
    finite = positions[np.isfinite(positions).all(axis=-1)]
    return finite.mean(axis=0, dtype=np.float64) if len(finite) else np.zeros(3)


def _parallel_view(name: str, yaw_deg: float, pitch_deg: float) -> View:
    return View(name, parallel_matrix(math.radians(yaw_deg), math.radians(pitch_deg)))


def _angle_view(text: str) -> View:
    yaw, comma, pitch = (piece.strip() for piece in text.removeprefix("yaw:").partition(","))
    if comma and not pitch.startswith("pitch:"):
        raise BadInput(f"view {text!r}: a pitch is expected after the comma, e.g. yaw:45,pitch:10")
    yaw_deg = _degrees(text, yaw)
    pitch_deg = _degrees(text, pitch.removeprefix("pitch:")) if comma else 0.0
    if abs(pitch_deg) > 90:
        raise BadInput(f"view {text!r}: pitch is -90 (from below) to 90 (from above); turn the yaw by 180 instead")
    return _parallel_view(text.replace(" ", ""), yaw_deg, pitch_deg)


def _degrees(view: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise BadInput(f"view {view!r}: {text!r} is not an angle in degrees; e.g. yaw:45 or yaw:45,pitch:10")
    return value


def _hint(text: str) -> str:
    near = difflib.get_close_matches(text.lower(), PRINCIPAL_PLANES_DEG, 1)
    return f"did you mean {near[0]}?" if near else f"known: {KNOWN_VIEWS}"


BLOCK_PX = 16
"""Encoders pad pictures to whole blocks at the right and below, or cut these off again: 1088 and 1080 are one size."""
SAME_SHAPE = 0.005
"""Relative difference of the two scales that rounding explains: 854x480 is 1920x1080."""


def picture_scale(view: View, size_px: Size) -> float:
    """From pixels of the pictures, which are `size_px` (width, height), to those of the view's camera file.

    1 for views without a size. Raises BadInput for pictures of another shape than the camera file's.
    """
    if view.size_px is None or _blocks(view.size_px) == _blocks(size_px):
        return 1.0
    across, down = (calibrated / actual for calibrated, actual in zip(view.size_px, size_px, strict=True))
    if abs(across - down) > SAME_SHAPE * across:
        width, height = view.size_px
        raise BadInput(
            f"pictures of {_text(size_px)} px, but the camera file of {view.name} is for {_text(view.size_px)}, "
            f"another shape; set size_px = [{width}, {height}] in the scene file, or calibrate again with such pictures"
        )
    return across


def scale_note(view: View, size_px: Size) -> str:
    """One line if the pictures are scaled to the camera file; "" if not. Raises BadInput as `picture_scale` does."""
    scale = picture_scale(view, size_px)
    if scale == 1.0 or view.size_px is None:
        return ""
    return (
        f"pictures of {_text(size_px)} px are scaled by {scale:.3g} to the {_text(view.size_px)} px of the camera file "
        f"of {view.name}: right if the camera shows as much in both sizes; if it cuts one out, calibrate again"
    )


def size_advice(view: View, size_px: Size) -> str:
    """`scale_note`, or why the pictures do not fit the camera file; "" if there is nothing to say."""
    try:
        return scale_note(view, size_px)
    except BadInput as error:
        return str(error)


def _blocks(size_px: Size) -> Size:
    return -(-size_px[0] // BLOCK_PX), -(-size_px[1] // BLOCK_PX)


def _text(size_px: Size) -> str:
    return f"{size_px[0]}x{size_px[1]}"
