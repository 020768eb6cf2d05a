"""Pictures in files: video files and folders of pictures, checked at opening and played in real time or faster."""

import logging
import math
import re
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import cv2
import numpy as np

from common import SECOND_NS
from common.errors import BadInput, reason_of
from observer.camera.capture import silence_opencv
from observer.files import write_file
from observer.motion.playback import FramePlayer, Start, begin_ns
from observer.tracks import Clock, Frame, Picture, Size, size_of

log = logging.getLogger("labanmesh.observer")

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
CHECKED = 100
"""How many pictures of a folder are checked at opening; the others are checked when they are played."""
FASTEST_HZ = 1000.0
"""A video that states a higher rate does not know it: 90000 is the tick rate of its clock."""
NEARLY_ALL = 0.9
"""A video is damaged when a smaller share of its stated pictures can be read; the stated count is often a bit off."""
_CONTAINERS = ((0, b"RIFF", "AVI"), (4, b"ftyp", "MP4"), (0, b"\x1a\x45\xdf\xa3", "Matroska"), (0, b"OggS", "Ogg"))
_HEADER_BYTES = 16
PICTURE_BYTES = 256 * 2**20
"""A picture is shorter; a device that never ends is none."""


Skips = Callable[[int], bool]
"""Whether to leave out the picture of this number, unless it is the last one."""


@dataclass(frozen=True, slots=True)
class PictureOfMany:
    """A picture of a film or a folder, its number from 0, and whether it is the last one."""

    number: int
    picture: Picture
    last: bool


@dataclass(frozen=True, slots=True)
class Video:
    """A video file whose first picture could be read. rate_hz: None when it states none. count: as it states."""

    path: Path
    rate_hz: float | None
    size_px: Size
    count: int

    @classmethod
    def open(cls, path: Path) -> "Video":
        """Read the first picture; BadInput when the file holds no readable video."""
        with _capture(path) as capture:
            first = _retrieve(capture) if _grab(capture) else None
            if first is None:
                raise BadInput(_why_unreadable(path))
            rate_hz, count = capture.get(cv2.CAP_PROP_FPS), capture.get(cv2.CAP_PROP_FRAME_COUNT)
        known = math.isfinite(rate_hz) and 0 < rate_hz <= FASTEST_HZ
        return cls(path, rate_hz if known else None, size_of(first), max(int(count), 1))

    def pictures(self) -> Iterator[Picture]:
        """All pictures from the first; raises as `played` does."""
        return (each.picture for each in self.played())

    def played(self, skips: Skips = lambda _: False) -> Iterator[PictureOfMany]:
        """The pictures from the first; BadInput when none can be read or one has another size.

        Skipped ones are decoded, since others depend on them, but not converted to colours.
        """
        read = 0
        with _capture(self.path) as capture:
            more = _grab(capture)
            while more:
                # To find the last picture again takes as long as all since the key picture before it.
                picture = None if skips(read) and read + 1 != self.count else _retrieve(capture)
                more = _grab(capture)
                if picture is None and not more:
                    picture = _again(capture, read)
                if picture is not None:
                    require_size(self.path, picture, self.size_px)
                    yield PictureOfMany(read, picture, last=not more)
                read += 1
        if not read:
            raise BadInput(_why_unreadable(self.path))
        if read < NEARLY_ALL * self.count:
            log.warning("%s: ends after %d of %d pictures: damaged or cut off", self.path, read, self.count)


@dataclass(frozen=True, slots=True)
class PictureFolder:
    """Picture files of one size, sorted by name with digits compared as numbers. rate_hz: None, it states none."""

    files: tuple[Path, ...]
    size_px: Size
    rate_hz: float | None = None

    @classmethod
    def open(cls, path: Path) -> "PictureFolder":
        """A folder of pictures, or one picture; BadInput for none, unreadable ones, and different sizes."""
        files = tuple(sorted(_pictures_in(path), key=_natural)) if path.is_dir() else (path,)
        if not files:
            raise BadInput(f"{path}: no pictures in this folder; names must end in {', '.join(PICTURES)}")
        size_px = size_of(read_picture(files[0]))
        for file in files[1 :: max(1, len(files) // CHECKED)]:
            require_size(file, read_picture(file), size_px, files[0].name)
        return cls(files, size_px)

    @property
    def count(self) -> int:
        """Number of pictures."""
        return len(self.files)

    def played(self, skips: Skips = lambda _: False) -> Iterator[PictureOfMany]:
        """The pictures, each read when it is played; BadInput for one that cannot be read or has another size."""
        for number, file in enumerate(self.files):
            last = number + 1 == self.count
            if last or not skips(number):
                picture = read_picture(file)
                require_size(file, picture, self.size_px, self.files[0].name)
                yield PictureOfMany(number, picture, last)


def read_picture(file: Path) -> Picture:
    """The picture in a file, rotated as its camera recorded; BadInput when it cannot be read."""
    silence_opencv()
    content = _read_bytes(file)
    try:
        picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:  # OpenCV calls some other files too large
        picture = None
    if picture is None:
        raise BadInput(f"{file}: not a readable picture: damaged, or not the format of its name")
    return cast("Picture", picture)


def write_picture(path: Path, picture: Picture) -> None:
    """Write in the format of the suffix, atomically; raises LabanmeshError when the file cannot be written."""
    write_file(path, cv2.imencode(path.suffix, picture)[1].tobytes())


def write_film(path: Path, rate_hz: float, size_px: Size, pictures: Iterable[Picture]) -> None:
    """Write pictures of one size as .mp4; an earlier film is replaced when this one is complete. May raise BadInput."""
    part, codec = path.with_name(f"{path.stem}.part{path.suffix}"), cv2.VideoWriter.fourcc(*"mp4v")
    silence_opencv()
    writer = cv2.VideoWriter(str(part.absolute()), cv2.CAP_FFMPEG, codec, rate_hz, size_px)
    if not writer.isOpened():
        raise BadInput(f"cannot write {path}, or this OpenCV makes no such film at {rate_hz:g} Hz")
    for picture in pictures:
        writer.write(picture)
    writer.release()
    part.replace(path)


def require_size(file: Path, picture: Picture, size_px: Size, like: str = "its first picture") -> None:
    """Raises BadInput unless the picture has this width and height, those of `like` in the error."""
    size = size_of(picture)
    if size != size_px:
        raise BadInput(
            f"{file}: {size[0]}x{size[1]} px, but {like} has {size_px[0]}x{size_px[1]}; "
            "all pictures of a source need one size"
        )


@contextmanager
def _capture(path: Path) -> Iterator[cv2.VideoCapture]:
    silence_opencv()
    _read_bytes(path, _HEADER_BYTES)
    # Absolute, so that FFmpeg does not read a name with a colon as an address.
    capture = cv2.VideoCapture(str(path.absolute()), cv2.CAP_FFMPEG)
    try:
        yield capture
    finally:
        capture.release()


def _grab(capture: cv2.VideoCapture) -> bool:
    """Decode the next picture; False at the end, and of a picture that cannot be decoded."""
    try:
        return capture.grab()
    except cv2.error:
        return False


def _retrieve(capture: cv2.VideoCapture) -> Picture | None:
    """The decoded picture."""
    try:
        good, picture = capture.retrieve()
    except cv2.error:
        return None
    return cast("Picture", picture) if good else None


def _again(capture: cv2.VideoCapture, number: int) -> Picture | None:
    """The picture of this number, which was decoded before it was known to be the last; None if it cannot be found."""
    capture.set(cv2.CAP_PROP_POS_FRAMES, number)
    return _retrieve(capture) if _grab(capture) else None


def _read_bytes(file: Path, count: int = -1) -> bytes:
    """The file's first `count` bytes, or the whole picture; BadInput when it is empty or cannot be read."""
    try:
        with file.open("rb") as stream:
            content = stream.read(count if count >= 0 else PICTURE_BYTES)
    except OSError as error:
        raise BadInput(f"cannot read {file}: {reason_of(error)}") from None
    if not content:
        raise BadInput(f"{file}: the file is empty: nothing was recorded, or the copy failed")
    return content


def _why_unreadable(path: Path) -> str:
    head = _read_bytes(path, _HEADER_BYTES)
    for at, magic, name in _CONTAINERS:
        if head[at : at + len(magic)] == magic:
            return (
                f"{path}: {name} file, but no picture can be read: unknown codec, or the recording was cut off; "
                "if another player shows it, convert it to H.264"
            )
    return f"{path}: not a video; known: formats that FFmpeg reads, such as .mp4, .avi, .mkv, and folders of pictures"


def _pictures_in(folder: Path) -> list[Path]:
    return [f for f in folder.iterdir() if f.suffix.lower() in PICTURES and not f.name.startswith(".")]


def _natural(file: Path) -> tuple[list[tuple[int, str]], str]:
    # Digits and text alternate, so that numbers are only compared with numbers.
    return [(int(t) if t.isdecimal() else -1, t) for t in re.split(r"(\d+)", file.name)], file.name


@dataclass(frozen=True, slots=True)
class RecordedPictures:
    """A FrameSource that plays pictures as `FramePlayer` does, and ends after the last.

    Picture i is captured at start + i / rate / speed; without `start_ns` the start is now. The last picture is never
    skipped, since a movement ends with it. played: starts from the first picture at each call. count: the number of
    pictures that the file states.
    """

    played: Callable[[Skips], Iterator[PictureOfMany]] = field(repr=False)
    rate_hz: float
    size_px: Size
    count: int
    speed: float = 1.0
    loop: bool = False
    start_ns: Start = None
    clock: Clock = time.time_ns
    body_parts: tuple[str, ...] = ()

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """Each picture when it is due. Raises BadInput when the files have changed since they were opened."""
        start_ns, before = begin_ns(self.start_ns, stop, self.clock), 0
        player = FramePlayer(self.speed, stop, self.clock)
        round_ns = self._played_ns(self.count)
        if self.loop and round_ns:
            # An observer that joins hours later need not read the film so many times.
            start_ns += max(self.clock() - start_ns, 0) // round_ns * round_ns

        def due_ns(number: int) -> int:
            return start_ns + self._played_ns(before + number)

        while True:
            count = 0
            for each in self.played(lambda number: player.skips(due_ns(number), due_ns(number + 1))):
                captured_ns = yield from player.wait(due_ns(each.number))
                if captured_ns is None:
                    return
                motion_ns = round((before + each.number) * SECOND_NS / self.rate_hz)
                yield player.delivers(Frame(captured_ns, each.picture, motion_ns, each.last))
                count = each.number + 1
            if not self.loop:
                return
            before += count or self.count

    def _played_ns(self, number: int) -> int:
        return round(number * SECOND_NS / self.rate_hz / self.speed) if self.speed else 0
