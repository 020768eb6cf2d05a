"""Opens the source that a text names: a webcam, an address, a video file or a folder of pictures."""

import math
from dataclasses import replace
from functools import partial
from pathlib import Path

from common.errors import BadInput
from common.text import without_secrets
from observer.camera.base import NOMINAL_HZ, SCHEMES, Report, ignore_report, kind_of
from observer.camera.capture import connect
from observer.camera.files import PICTURES, PictureFolder, RecordedPictures, Video
from observer.camera.live import LiveCamera
from observer.motion.playback import Start
from observer.tracks import FrameSource, Size

KNOWN = f'a webcam ("0", "/dev/video0"), an address ({", ".join(SCHEMES)}), a video file, a folder of pictures'


def open_pictures(
    text: str,
    folder: Path,
    *,
    report: Report = ignore_report,
    rate_hz: float | None = None,
    size_px: Size | None = None,
    speed: float = 1.0,
    loop: bool = False,
    start_ns: Start = None,
    show_path: bool = False,
) -> FrameSource:
    """The source that `text` names; relative paths are below `folder`.

    rate_hz: requested from a camera, or used instead of a recording's own rate. size_px: required width and height.
    speed, loop, start_ns: playback of recorded pictures, as in `RecordedPictures`. A live camera is
    opened when its frames are asked for, and may be absent until then. show_path: its name has the path of its address.

    Raises BadInput, which never contains a secret, for an unknown scheme, a missing or empty file, an unreadable
    video or codec, a folder without pictures, and pictures of different or wrong sizes.
    """
    if rate_hz is not None and not (math.isfinite(rate_hz) and rate_hz > 0):
        raise BadInput(f"{without_secrets(text)}: {rate_hz:g} pictures per second: a number above 0 is expected")
    kind = kind_of(text)
    if kind == "unknown scheme":
        schemes = ", ".join(f"{scheme}://" for scheme in SCHEMES)
        raise BadInput(f"{without_secrets(text)}: unknown kind of address; known: {schemes}")
    if kind == "path":
        recorded = _open_recorded(text, folder, rate_hz, size_px)
        return replace(recorded, speed=speed, loop=loop, start_ns=start_ns)
    rate_hz = rate_hz or NOMINAL_HZ
    name = f"camera {text}" if kind == "index" else without_secrets(text, show_path=show_path)
    return LiveCamera(name, partial(connect, text, rate_hz, size_px), report, rate_hz, size_px)


def _open_recorded(text: str, folder: Path, rate_hz: float | None, size_px: Size | None) -> RecordedPictures:
    path = folder / text
    if not path.exists() and (shown := without_secrets(text)) != text:
        raise BadInput(f"{shown}: an address without its scheme; write rtsp:// before it, or http://")
    if not text.strip() or not path.exists():
        raise BadInput(f"{path if text.strip() else repr(text)}: no such file or folder; a source is {KNOWN}")
    is_pictures = path.is_dir() or path.suffix.lower() in PICTURES
    recorded = PictureFolder.open(path) if is_pictures else Video.open(path)
    if size_px not in (None, recorded.size_px):
        width, height = size_px or recorded.size_px
        actual = "{}x{}".format(*recorded.size_px)
        raise BadInput(f"{path}: {actual} px, but {width}x{height} is expected, as calibrated")
    rate_hz = rate_hz or recorded.rate_hz or NOMINAL_HZ
    return RecordedPictures(recorded.played, rate_hz, recorded.size_px, recorded.count)
