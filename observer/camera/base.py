"""Types shared by all picture sources, and how a source's text is read; pure."""

from collections.abc import Callable
from typing import Literal

from common.messages import ProcessState

NOMINAL_HZ = 30.0
"""The rate of a source that states none: a live camera before it is opened, a folder of pictures."""


Report = Callable[[ProcessState, str], None]
"""Receives the state of a source at each change, in the thread that takes the frames: `degraded` with the reason while
no usable picture comes, `running` with "" when pictures come again."""


class CameraFault(Exception):  # noqa: N818 - names what happened; never shown as an error
    """A camera cannot be opened or has stopped delivering; one readable line. Opening it again may help."""


def ignore_report(state: ProcessState, reason: str) -> None:
    """Do nothing: the default `Report`. Sources log each change in any case."""


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
