"""Outputs of painted pictures: a film, single pictures or a window."""

import logging
import os
import sys
from collections.abc import Mapping
from pathlib import Path

import cv2

from common import SECOND_NS
from common.errors import BadInput, LabanmeshError
from common.text import plural
from observer.camera.capture import silence_opencv
from observer.camera.files import write_picture
from observer.files import make_private
from observer.preview.drawing import SIZE
from observer.preview.sight import Picture

log = logging.getLogger("labanmesh.observer")

CODECS = {".mp4": "mp4v", ".avi": "MJPG"}
STILLS = (".png", ".jpg", ".jpeg")
CHOOSE = "Choose another path"
LONGEST_PAUSE_S = 2.0
"""Longest pause in a film; a longer silence of the camera is cut to it."""


class Film:
    """A video file, written under a temporary name until it is closed, so that it is complete or absent.

    rate_hz: frame rate of the film. keep_all: one film frame per picture; otherwise the film keeps real time and
    repeats or drops pictures. size_px: of the pictures, width and height. unnamed: nobody has named the file, so that
    only this user may read it. Raises BadInput when it cannot be written.
    """

    def __init__(
        self, path: Path, rate_hz: float, keep_all: bool, *, size_px: tuple[int, int] = SIZE, unnamed: bool = False
    ) -> None:
        self._path, self._rate_hz, self._keep_all = path, rate_hz, keep_all
        self._partial = path.with_name(f"{path.stem}.part{path.suffix}")
        silence_opencv()
        _check_writable(self._partial, path)
        if unnamed:
            make_private(self._partial)
        codec = cv2.VideoWriter.fourcc(*CODECS[path.suffix.lower()])
        self._writer = cv2.VideoWriter(str(self._partial.absolute()), cv2.CAP_FFMPEG, codec, rate_hz, size_px)
        if not self._writer.isOpened():
            self._partial.unlink(missing_ok=True)
            raise BadInput(f"{path}: this OpenCV cannot write it at {rate_hz:g} Hz; use a name that ends in .avi")
        self._begin_ns: int | None = None
        self._written = 0

    def draw(self, picture: Picture, shown_ns: int) -> None:
        """Write the picture once, or as often as real time requires."""
        for _ in range(1 if self._keep_all else self._due(shown_ns)):
            self._writer.write(picture)
            self._written += 1

    def _due(self, shown_ns: int) -> int:
        if self._begin_ns is None:
            self._begin_ns = shown_ns
        due = round((shown_ns - self._begin_ns) / SECOND_NS * self._rate_hz) + 1 - self._written
        excess = due - max(1, round(LONGEST_PAUSE_S * self._rate_hz))
        if excess > 0:
            self._begin_ns += round(excess / self._rate_hz * SECOND_NS)
        return max(0, due - max(0, excess))

    def close(self) -> None:
        """Give the file its name; a film without pictures is removed."""
        self._writer.release()
        if not self._written:
            self._partial.unlink(missing_ok=True)
            log.warning("%s: not written: no picture was shown", self._path)
            return
        self._partial.replace(self._path)
        log.info("%s: %s", self._path, plural(self._written, "picture"))


class Stills:
    """Single pictures. path: a folder (000000.png, ...), a name with %d or %06d, or a plain name for only the newest.

    Raises BadInput when they cannot be written.
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
            raise BadInput(f"cannot write {path}: {error.strerror}. {CHOOSE}") from None
        except (TypeError, ValueError):
            raise BadInput(f"{path.name}: one number is expected in the name, e.g. frame-%06d.png") from None
        self._path, self._count = path, 0
        partial = path.with_name(f".{os.getpid()}.part{path.suffix}")
        _check_writable(partial, path)
        partial.unlink()

    def draw(self, picture: Picture, shown_ns: int) -> None:
        """Write one file, atomically."""
        path = self._path.with_name(self._path.name % self._count) if self._numbered else self._path
        write_picture(path, picture, CHOOSE)
        self._count += 1

    def close(self) -> None:
        """Log the number of files; each is complete already."""
        log.info("%s: %s", self._path, plural(self._count, "picture"))


class Window:
    """A window on this machine's display; `why_no_window` tells whether one can be opened."""

    def __init__(self, title: str) -> None:
        self._title, self._open = title, False

    def draw(self, picture: Picture, shown_ns: int) -> None:
        """Show the picture; raises LabanmeshError when the window was closed or q was pressed."""
        try:
            if not self._open:
                cv2.namedWindow(self._title, cv2.WINDOW_NORMAL)
                cv2.resizeWindow(self._title, *SIZE)
            elif cv2.getWindowProperty(self._title, cv2.WND_PROP_VISIBLE) < 1:
                self._open = False
                raise LabanmeshError("the preview window was closed; the observer continues")
            self._open = True
            cv2.imshow(self._title, picture)
            if cv2.waitKey(1) & 0xFF == ord("q"):
                raise LabanmeshError("the preview was ended with q; the observer continues")
        except cv2.error as error:
            raise LabanmeshError(f"the preview window failed: {error.err}") from None

    def close(self) -> None:
        """Close the window."""
        if self._open:
            cv2.destroyWindow(self._title)


Outlet = Film | Stills | Window
"""Receives painted pictures of `drawing.SIZE`; used by one thread at a time."""


def why_no_window(environment: Mapping[str, str] = os.environ, platform: str = sys.platform) -> str:
    """Why OpenCV cannot open a window here; "" when it can."""
    if "GUI:NONE" in "".join(cv2.getBuildInformation().split()):
        return "this OpenCV was built without windows (opencv-python-headless)"
    if platform == "darwin":
        return "on macOS only the main thread can open windows"
    if platform == "linux" and not (environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY")):
        return "there is no display (DISPLAY and WAYLAND_DISPLAY are not set)"
    return ""


def _check_writable(partial: Path, path: Path) -> None:
    """Raise BadInput unless `partial` can be created and then renamed to `path`."""
    try:
        partial.open("wb").close()
    except OSError as error:
        raise BadInput(f"cannot write {path}: {error.strerror}. {CHOOSE}") from None
    if path.is_dir():
        partial.unlink()
        raise BadInput(f"cannot write {path}: it is a folder. Name a file in it")
