"""Where painted pictures go: a film, single pictures, or a window. Each says in one line when it cannot."""

import logging
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

import cv2

from common import SECOND_NS
from common.errors import BadInput, LabanmeshError
from observer.camera.capture import silence_opencv
from observer.preview.drawing import SIZE
from observer.preview.sight import Picture

log = logging.getLogger("labanmesh.observer")

CODECS = {".mp4": "mp4v", ".avi": "MJPG"}
STILLS = (".png", ".jpg", ".jpeg")
PAUSE_S = 2.0
"""A film shows a longer silence of the camera as one of so many seconds."""


class Outlet(Protocol):
    """Takes painted pictures; used by one thread at a time."""

    def draw(self, picture: Picture, shown_ns: int) -> None:
        """One picture of `layout.SIZE`, shown at that time. LabanmeshError when nothing more can be taken."""

    def close(self) -> None:
        """What was drawn is whole now."""


class Film:
    """A video file, whole or not there: it grows under another name until it is closed.

    rate_hz: pictures a second of film. keep_all: one picture of film for each that is drawn; else the film keeps the
    time at which they were shown, whatever was left out. Raises BadInput when it cannot be written.
    """

    def __init__(self, path: Path, rate_hz: float, keep_all: bool) -> None:
        self._path, self._rate_hz, self._keep_all = path, rate_hz, keep_all
        self._growing = path.with_name(f"{path.stem}.part{path.suffix}")
        silence_opencv()
        _claim(self._growing, path)
        codec = cv2.VideoWriter.fourcc(*CODECS[path.suffix.lower()])
        self._writer = cv2.VideoWriter(str(self._growing.absolute()), cv2.CAP_FFMPEG, codec, rate_hz, SIZE)
        if not self._writer.isOpened():
            self._growing.unlink(missing_ok=True)
            raise BadInput(f"{path}: this OpenCV cannot write it at {rate_hz:g} Hz; try a name that ends in .avi")
        self._begin_ns: int | None = None
        self._written = 0

    def draw(self, picture: Picture, shown_ns: int) -> None:
        """So often as the film needs it: once, or none or several times when it keeps the time."""
        for _ in range(1 if self._keep_all else self._due(shown_ns)):
            self._writer.write(picture)
            self._written += 1

    def _due(self, shown_ns: int) -> int:
        if self._begin_ns is None:
            self._begin_ns = shown_ns
        missing = round((shown_ns - self._begin_ns) / SECOND_NS * self._rate_hz) + 1 - self._written
        too_many = missing - max(1, round(PAUSE_S * self._rate_hz))
        if too_many > 0:
            self._begin_ns += round(too_many / self._rate_hz * SECOND_NS)
        return max(0, missing - max(0, too_many))

    def close(self) -> None:
        """The file gets its name; one without pictures is not kept."""
        self._writer.release()
        if not self._written:
            self._growing.unlink(missing_ok=True)
            log.warning("%s: not written: nothing was seen", self._path)
            return
        self._growing.replace(self._path)
        log.info("%s: %d pictures", self._path, self._written)


class Stills:
    """Single pictures. path: a folder (000000.png, ...), a name with %d or %06d, or a plain name for the newest alone.

    Raises BadInput when that place cannot be written.
    """

    def __init__(self, path: Path) -> None:
        try:
            if path.suffix.lower() not in STILLS:
                path.mkdir(parents=True, exist_ok=True)
                path = path / "%06d.png"
            self._numbered = "%" in path.name
            if self._numbered:
                str(path.name) % 0
        except OSError as error:
            raise BadInput(f"{path}: cannot be written: {error.strerror}") from None
        except (TypeError, ValueError):
            raise BadInput(f"{path.name}: one number is expected in the name, such as frame-%06d.png") from None
        self._path, self._count = path, 0
        growing = self._growing
        _claim(growing, path)
        growing.unlink()

    @property
    def _growing(self) -> Path:
        return self._path.with_name(f".{os.getpid()}.part{self._path.suffix}")

    def draw(self, picture: Picture, shown_ns: int) -> None:
        """One file; nobody ever reads half of it."""
        path = self._path.with_name(self._path.name % self._count) if self._numbered else self._path
        write_picture(path, picture, self._growing)
        self._count += 1

    def close(self) -> None:
        """All files are whole already."""
        log.info("%s: %d pictures", self._path, self._count)


class Window:
    """A window on this machine's display; `why_no_window` says whether there can be one."""

    def __init__(self, title: str) -> None:
        self._title, self._open = title, False

    def draw(self, picture: Picture, shown_ns: int) -> None:
        """The picture in place of the last. LabanmeshError when the person has closed the window or pressed q."""
        try:
            if not self._open:
                cv2.namedWindow(self._title, cv2.WINDOW_NORMAL)
                cv2.resizeWindow(self._title, *SIZE)
            elif cv2.getWindowProperty(self._title, cv2.WND_PROP_VISIBLE) < 1:
                self._open = False
                raise LabanmeshError("the preview's window was closed; the observer goes on")
            self._open = True
            cv2.imshow(self._title, picture)
            if cv2.waitKey(1) & 0xFF == ord("q"):
                raise LabanmeshError("the preview was ended by q; the observer goes on")
        except cv2.error as error:
            raise LabanmeshError(f"the preview's window: {error.err}") from None

    def close(self) -> None:
        """The window goes."""
        if self._open:
            cv2.destroyWindow(self._title)


def why_no_window(environment: Mapping[str, str] = os.environ, platform: str = sys.platform) -> str:
    """The reason in words why OpenCV can open no window here; "" when it can."""
    if "GUI:NONE" in "".join(cv2.getBuildInformation().split()):
        return "this OpenCV was built without windows (opencv-python-headless)"
    if platform == "darwin":
        return "on a Mac only a program's first thread may have windows"
    if platform == "linux" and not (environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY")):
        return "there is no display (DISPLAY and WAYLAND_DISPLAY are not set)"
    return ""


def write_picture(path: Path, picture: Picture, growing: Path) -> None:
    """Writes by the name's ending, under the name `growing` first; LabanmeshError when the disk does not take it."""
    try:
        growing.write_bytes(cv2.imencode(path.suffix, picture)[1].tobytes())
        growing.replace(path)
    except OSError as error:
        raise LabanmeshError(f"{path}: cannot be written: {error.strerror}") from None


def _claim(growing: Path, path: Path) -> None:
    """BadInput unless a file of that name can be made and then take the name `path`."""
    try:
        growing.open("wb").close()
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror}") from None
    if path.is_dir():
        growing.unlink()
        raise BadInput(f"{path}: is a folder; give a name for the file in it")
