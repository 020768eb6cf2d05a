"""Types shared by all picture sources, and how a source's text is read; pure."""

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from common.messages import ProcessState

Picture = NDArray[np.uint8]
"""(H, W, 3) in the order blue, green, red, 0 to 255; row 0 is the top row."""

Size = tuple[int, int]
"""Width and height of a picture in px, the order of `image_size_px` in a camera file."""

Clock = Callable[[], int]
"""Returns nanoseconds: since 1970 for capture times, since any moment for durations."""

NOMINAL_HZ = 30.0
"""The rate of a source that states none: a live camera before it is opened, a folder of pictures."""


Report = Callable[[ProcessState, str], None]
"""Receives the state of a source at each change, in the thread that takes the frames: `degraded` with the reason while
no usable picture comes, `running` with "" when pictures come again."""


class CameraFault(Exception):  # noqa: N818 - names what happened; never shown as an error
    """A camera cannot be opened or has stopped delivering; one readable line. Opening it again may help."""


def ignore_report(state: ProcessState, reason: str) -> None:
    """Do nothing: the default `Report`. Sources log each change in any case."""


def size_of(picture: Picture) -> Size:
    """Width and height in px."""
    return picture.shape[1], picture.shape[0]


def require_picture(content: NDArray[Any], least_px: int = 1) -> Picture:
    """The content if it is a picture of at least `least_px` each way; raises BadInput otherwise."""
    if content.ndim != 3 or content.shape[2] != 3 or content.dtype != np.uint8 or min(content.shape[:2]) < least_px:
        raise BadInput(
            f"picture {content.shape} of {content.dtype}: (H, W, 3) of uint8 in the order blue, green, red is expected,"
            f" at least {least_px} px each way"
        )
    return content


SCHEMES = ("rtsp", "rtsps", "http", "https")

Kind = Literal["index", "device", "url", "unknown scheme", "path"]


def kind_of(text: str) -> Kind:
    """The kind of source that the text names: "0", "/dev/video0", "rtsp://...", "clip.mp4", "pictures/"."""
    if text.isdecimal():
        return "index"
    if text.startswith(("/dev/video", "/dev/v4l/")):
        return "device"
    scheme, separator, _ = text.partition("://")
    if not separator:
        return "path"
    return "url" if scheme.lower() in SCHEMES else "unknown scheme"
