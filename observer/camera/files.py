"""Recorded pictures: video files and folders of pictures, checked at opening and played in real time or faster."""

import logging
import math
import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import cv2
import numpy as np

from common.errors import BadInput
from observer.camera.base import Clock, Picture, Size, size_of
from observer.camera.capture import be_quiet
from observer.camera.live import SECOND_NS
from observer.motion.playback import wait_until
from observer.tracks import Frame

log = logging.getLogger("labanmesh.observer")

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
CHECKED = 100
"""So many pictures of a folder are looked at before it is played; the others when their turn comes."""
FASTEST_HZ = 1000.0
"""A video that claims more does not know its rate: 90000 is the unit of a clock."""
NEARLY_ALL = 0.9
"""A video of which a smaller part can be read than this is damaged; what it says that it holds is often a bit off."""

_CONTAINERS = ((0, b"RIFF", "AVI"), (4, b"ftyp", "MP4"), (0, b"\x1a\x45\xdf\xa3", "Matroska"), (0, b"OggS", "Ogg"))
_NEEDED = 16
"""Bytes of a file that tell what it is."""


@dataclass(frozen=True, slots=True)
class Video:
    """A video file whose first picture could be read. rate_hz: None if it does not say. count: as it says."""

    path: Path
    rate_hz: float | None
    size_px: Size
    count: int

    @classmethod
    def open(cls, path: Path) -> "Video":
        """Looks into the file; BadInput when it holds no video that can be read."""
        with _capture(path) as capture:
            first = _next(capture)
            if first is None:
                raise BadInput(_why_unreadable(path))
            rate_hz, count = capture.get(cv2.CAP_PROP_FPS), capture.get(cv2.CAP_PROP_FRAME_COUNT)
        known = math.isfinite(rate_hz) and 0 < rate_hz <= FASTEST_HZ
        return cls(path, rate_hz if known else None, size_of(first), max(int(count), 1))

    def pictures(self) -> Iterator[Picture]:
        """All pictures from the first; BadInput if none can be read any more or one has another size."""
        read = 0
        with _capture(self.path) as capture:
            while (picture := _next(capture)) is not None:
                require_size(self.path, picture, self.size_px)
                yield picture
                read += 1
        if not read:
            raise BadInput(_why_unreadable(self.path))
        if read < NEARLY_ALL * self.count:
            log.warning("%s: ends after %d of %d pictures: damaged or cut off", self.path, read, self.count)


@dataclass(frozen=True, slots=True)
class Album:
    """Picture files of one size, in the order of their names with numbers as numbers."""

    files: tuple[Path, ...]
    size_px: Size

    @classmethod
    def open(cls, place: Path) -> "Album":
        """A folder of pictures, or one picture; BadInput for none, unreadable ones, and different sizes."""
        files = tuple(sorted(_pictures_in(place), key=_natural)) if place.is_dir() else (place,)
        if not files:
            raise BadInput(f"{place}: no pictures in this folder; names must end in {', '.join(PICTURES)}")
        size_px = size_of(read_picture(files[0]))
        for file in files[1 :: max(1, len(files) // CHECKED)]:
            require_size(file, read_picture(file), size_px, files[0].name)
        return cls(files, size_px)

    def pictures(self) -> Iterator[Picture]:
        """All pictures, each read when its turn comes; BadInput for one that cannot be read or has another size."""
        for file in self.files:
            picture = read_picture(file)
            require_size(file, picture, self.size_px, self.files[0].name)
            yield picture


def read_picture(file: Path) -> Picture:
    """The picture in a file, upright as its camera noted; BadInput when it cannot be read."""
    be_quiet()
    content = _opened(file, whole=True)
    try:
        picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:  # too large, says OpenCV, of what is no picture
        picture = None
    if picture is None:
        raise BadInput(f"{file}: not a picture that can be read: damaged, or another format than its name says")
    return cast("Picture", picture)


def require_size(file: Path, picture: Picture, size_px: Size, like: str = "its first picture") -> None:
    """BadInput unless the picture has this width and height."""
    size = size_of(picture)
    if size != size_px:
        raise BadInput(
            f"{file}: {size[0]}x{size[1]} px, but {like} has {size_px[0]}x{size_px[1]}; one source, one size"
        )


@contextmanager
def _capture(path: Path) -> Iterator[cv2.VideoCapture]:
    be_quiet()
    _opened(path)
    # Absolute, so that FFmpeg does not take a name with a colon for an address.
    capture = cv2.VideoCapture(str(path.absolute()), cv2.CAP_FFMPEG)
    try:
        yield capture
    finally:
        capture.release()


def _next(capture: cv2.VideoCapture) -> Picture | None:
    try:
        good, picture = capture.read()
    except cv2.error:
        return None
    return cast("Picture", picture) if good else None


def _opened(file: Path, whole: bool = False) -> bytes:
    """The file's first bytes, or all of them; BadInput when there are none."""
    try:
        with file.open("rb") as stream:
            content = stream.read() if whole else stream.read(_NEEDED)
    except OSError as error:
        raise BadInput(f"{file}: {error.strerror}") from None
    if not content:
        raise BadInput(f"{file}: zero bytes: nothing was recorded, or the copy failed")
    return content


def _why_unreadable(path: Path) -> str:
    head = _opened(path)
    for at, magic, name in _CONTAINERS:
        if head[at : at + len(magic)] == magic:
            return (
                f"{path}: {name} of which no picture can be read: an unknown codec, or its recording was cut off; "
                "if another player shows it, convert it to H.264"
            )
    return f"{path}: not a video; known: what FFmpeg reads, such as .mp4, .avi, .mkv, and folders of pictures"


def _pictures_in(folder: Path) -> list[Path]:
    return [f for f in folder.iterdir() if f.suffix.lower() in PICTURES and not f.name.startswith(".")]


def _natural(file: Path) -> tuple[list[tuple[int, str]], str]:
    # Digits and other text alternate, so that a number is only ever compared with a number.
    return [(int(t) if t.isdecimal() else -1, t) for t in re.split(r"(\d+)", file.name)], file.name


@dataclass(frozen=True, slots=True)
class RecordedPictures:
    """Plays pictures as `RecordedMotion` plays motion: a PictureSource that ends after the last.

    Picture i is captured at start + i / rate / speed; without `start_ns` that is now. speed 0: no waiting, and the
    time of capture is the time of playing. When the observer is slower, pictures come late and none is left out.
    pictures: begins at the first each time it is called. count: how many the file says that it holds.
    """

    pictures: Callable[[], Iterator[Picture]] = field(repr=False)
    rate_hz: float
    size_px: Size
    count: int
    speed: float = 1.0
    loop: bool = False
    start_ns: int | None = None
    clock: Clock = time.time_ns
    body_parts: tuple[str, ...] = ()

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """Each picture when it is due. Raises BadInput when the files are no longer what they were at opening."""
        start_ns = self.clock() if self.start_ns is None else self.start_ns
        for i, picture in enumerate(self._all()):
            offset_ns = round(i * SECOND_NS / self.rate_hz / self.speed) if self.speed else 0
            captured_ns = wait_until(start_ns + offset_ns, self.speed, stop, self.clock)
            if captured_ns is None:
                return
            yield Frame(captured_ns, picture, round(i * SECOND_NS / self.rate_hz))

    def _all(self) -> Iterator[Picture]:
        yield from self.pictures()
        while self.loop:
            yield from self.pictures()
