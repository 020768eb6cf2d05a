"""Types shared by all picture sources, and the meaning of a source's address; pure."""

import re
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from common.messages import ProcessState
from observer.tracks import Frame

if TYPE_CHECKING:
    import threading

Picture = NDArray[np.uint8]
"""(H, W, 3) blue, green, red, 0 to 255; row 0 is the top."""

Size = tuple[int, int]
"""Width and height of a picture, px: the order of `image_size_px` in a camera file."""

Clock = Callable[[], int]
"""Nanoseconds: since 1970 for capture times, since anything for durations."""

NOMINAL_HZ = 30.0
"""The rate of what does not say its own: a live camera before it was asked, a folder of pictures."""


class Report(Protocol):
    """Hears how a source is, at each change; called in the thread that takes the frames."""

    def __call__(self, state: ProcessState, reason: str) -> None:
        """`degraded` with the reason in words while nothing useful comes, `running` with "" when it does again."""


class PictureSource(Protocol):
    """A `observer.tracks.FrameSource` whose frames hold pictures, all of one size."""

    @property
    def rate_hz(self) -> float:
        """Pictures per second: at this rate they were taken, however fast they are played."""

    @property
    def body_parts(self) -> tuple[str, ...]:
        """None: what is in a picture, only a tracker knows."""

    def frames(self, stop: "threading.Event") -> Iterator[Frame]:
        """Frames whose content is a Picture; ends soon after `stop` is set."""


class CameraFault(Exception):  # noqa: N818 - it names what happened, and is never shown as an error
    """A camera could not be opened or delivers no more; the message is one readable line. Opening again may help."""


def unheard(state: ProcessState, reason: str) -> None:
    """The Report of who does not want to know; sources log each change anyway."""


def size_of(picture: Picture) -> Size:
    """Width and height, px."""
    return picture.shape[1], picture.shape[0]


def frame_of(captured_ns: int, picture: Picture) -> Frame:
    """A frame that holds a picture."""
    return Frame(captured_ns, picture)


SCHEMES = ("rtsp", "rtsps", "http", "https")

Kind = Literal["index", "device", "url", "unknown scheme", "path"]

_HOST = re.compile(r"(\[[0-9a-fA-F:.]+\]|[\w.-]+)(:\d+)?")


def kind_of(text: str) -> Kind:
    """Which kind of source the text names: "0", "/dev/video0", "rtsp://...", "clip.mp4", "pictures/"."""
    if text.isdecimal():
        return "index"
    if text.startswith(("/dev/video", "/dev/v4l/")):
        return "device"
    scheme, separator, _ = text.partition("://")
    if not separator:
        return "path"
    return "url" if scheme.lower() in SCHEMES else "unknown scheme"


def shown(text: str) -> str:
    """The text as it may be printed: of an address only scheme, host, port and a path that holds no secret.

    User, password and query are left out. Where a badly quoted password could pass for something else (an @ or no
    host where they should not be), and so for any scheme, nothing but the scheme is shown.
    """
    scheme, separator, rest = text.partition("://")
    if not separator:
        return text
    authority, path, query = _split(rest)
    host = authority.rpartition("@")[2]
    if "@" in path or "@" in query or not _HOST.fullmatch(host):
        return f"{scheme}://..."
    # Some cameras want /user=NAME_password=SECRET_channel=1 as the path.
    return f"{scheme}://{host}{'/...' if '=' in path else path}"


def _split(rest: str) -> tuple[str, str, str]:
    """Authority, path, and query with fragment, of an address without its scheme."""
    authority = re.split(r"[/?#]", rest, maxsplit=1)[0]
    path = re.split(r"[?#]", rest[len(authority) :], maxsplit=1)[0]
    return authority, path, rest[len(authority) + len(path) :]
