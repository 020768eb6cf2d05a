"""Opens whatever the text of a source names: a webcam, an address, a video file, a folder of pictures."""

import math
from functools import partial
from pathlib import Path

from common.errors import BadInput
from observer.camera.base import NOMINAL_HZ, SCHEMES, PictureSource, Report, Size, kind_of, shown, unheard
from observer.camera.capture import connect
from observer.camera.files import PICTURES, Album, RecordedPictures, Video
from observer.camera.live import LiveCamera

KNOWN = f'a webcam ("0", "/dev/video0"), an address ({", ".join(SCHEMES)}), a video file, a folder of pictures'


def open_pictures(
    text: str,
    folder: Path,
    *,
    report: Report = unheard,
    rate_hz: float | None = None,
    size_px: Size | None = None,
    speed: float = 1.0,
    loop: bool = False,
    start_ns: int | None = None,
) -> PictureSource:
    """The source that `text` names; relative paths are below `folder`.

    rate_hz: what a camera is asked for, or the rate of recorded pictures instead of their own. size_px: width and
    height that the pictures must have. speed, loop, start_ns (Unix epoch, ns): how recorded pictures are played, as
    in `observer.motion.playback.RecordedMotion`.
    A live camera is not opened before its frames are asked for, and may be away.

    Raises BadInput, which never shows a password, for what cannot be a source: an unknown scheme, no such file, zero
    bytes, no video or a codec that cannot be read, no pictures, pictures of different or wrong sizes.
    """
    if rate_hz is not None and not (math.isfinite(rate_hz) and rate_hz > 0):
        raise BadInput(f"{shown(text)}: {rate_hz:g} pictures per second: a number above 0 is expected")
    kind = kind_of(text)
    if kind == "unknown scheme":
        raise BadInput(f"{shown(text)}: unknown kind of address; known: {', '.join(f'{s}://' for s in SCHEMES)}")
    if kind == "path":
        return _recorded(text, folder, rate_hz, size_px, speed, loop, start_ns)
    rate_hz = rate_hz or NOMINAL_HZ
    name = f"camera {text}" if kind == "index" else shown(text)
    return LiveCamera(name, partial(connect, text, rate_hz, size_px), report, rate_hz, size_px)


def _recorded(
    text: str,
    folder: Path,
    rate_hz: float | None,
    size_px: Size | None,
    speed: float,
    loop: bool,
    start_ns: int | None,
) -> RecordedPictures:
    place = folder / text
    if not text.strip() or not place.exists():
        raise BadInput(f"{place if text.strip() else repr(text)}: no such file or folder; a source is {KNOWN}")
    if place.is_dir() or place.suffix.lower() in PICTURES:
        album = Album.open(place)
        found, own_hz, count, size = album.pictures, None, len(album.files), album.size_px
    else:
        video = Video.open(place)
        found, own_hz, count, size = video.pictures, video.rate_hz, video.count, video.size_px
    if size_px not in (None, size):
        width, height = size_px or size
        raise BadInput(f"{place}: {size[0]}x{size[1]} px, but {width}x{height} is expected, as calibrated")
    return RecordedPictures(found, rate_hz or own_hz or NOMINAL_HZ, size, count, speed, loop, start_ns)
