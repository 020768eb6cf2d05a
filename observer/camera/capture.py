"""Opens and reads cameras with OpenCV, and keeps OpenCV and FFmpeg from writing to the terminal."""

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import cast

import cv2

from common.errors import BadInput
from observer.camera.base import CameraFault, kind_of
from observer.tracks import Picture, Size

OPEN_TIMEOUT_MS = 2000
"""Timeout for the first answer of a network camera."""
READ_TIMEOUT_MS = 1000
"""Timeout for the next picture of a network camera; after it the stream is opened again."""
TIMEOUTS = (cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, OPEN_TIMEOUT_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, READ_TIMEOUT_MS)
_SILENT = 0  # OpenCV's LOG_LEVEL_SILENT


def silence_opencv() -> None:
    """Stop OpenCV and FFmpeg from writing to stderr, unless the environment asks for it.

    FFmpeg reads its setting once, at its first use in the process.
    """
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    if "OPENCV_LOG_LEVEL" not in os.environ:
        # OpenCV 4.11 has the first function, 4.14 the second.
        set_level = getattr(cv2, "setLogLevel", None) or cv2.utils.logging.setLogLevel
        set_level(_SILENT)


class OpenCvCamera:
    """An open camera, used by one thread."""

    def __init__(self, capture: cv2.VideoCapture) -> None:
        self._capture = capture

    def read(self) -> tuple[int, Picture]:
        """Wait for the next picture; return its capture time (Unix epoch, ns) and the picture.

        The time is taken when OpenCV has grabbed the picture, before it is decoded. Raises CameraFault when no picture
        comes.
        """
        try:
            grabbed = self._capture.grab()
            captured_ns = time.time_ns()
            good, picture = self._capture.retrieve() if grabbed else (False, None)
        except cv2.error as error:
            raise CameraFault(f"delivers no more pictures: {error.err}") from None
        if not good or picture is None or picture.size == 0:
            raise CameraFault("delivers no more pictures")
        return captured_ns, cast("Picture", picture)

    def close(self) -> None:
        """Release the device or the connection."""
        self._capture.release()


Connect = Callable[[], OpenCvCamera]
"""Opens the camera; raises CameraFault when that fails now."""


def connect(text: str, rate_hz: float, size_px: Size | None = None) -> OpenCvCamera:
    """Open the camera "0", "/dev/video0" or at an address; a webcam is asked for the rate and the size.

    Raises CameraFault when it cannot be opened.
    """
    silence_opencv()
    kind = kind_of(text)
    try:
        if kind == "url":
            capture = cv2.VideoCapture(text, cv2.CAP_FFMPEG, TIMEOUTS)
        else:
            capture = cv2.VideoCapture(int(text)) if kind == "index" else cv2.VideoCapture(text, cv2.CAP_V4L2)
        if not capture.isOpened():
            raise CameraFault(_reason(text))
        if kind != "url":
            _request(capture, rate_hz, size_px)
    except cv2.error:
        raise CameraFault(_reason(text)) from None
    return OpenCvCamera(capture)


def require_device(text: str) -> None:
    """Raise BadInput when `text` names a webcam whose device file does not exist; other sources pass.

    Only Linux shows a webcam as a file. A device that exists may still be busy.
    """
    device = _missing_device(text)
    if device is not None:
        raise BadInput(f"camera {text}: there is no {device}. {_OTHER}; {_WHICH}")


_WHICH = "labanmesh doctor lists the cameras of this machine"
_OTHER = "Plug a camera in, or name another, a film or an address"


def _missing_device(text: str) -> Path | None:
    kind = kind_of(text)
    if kind not in ("index", "device") or sys.platform != "linux":
        return None
    device = Path(f"/dev/video{int(text)}" if kind == "index" else text)
    return None if device.exists() else device


def _reason(text: str) -> str:
    if kind_of(text) == "url":
        return "does not answer, or sends no video: is it on, in this network, and are its address and password right?"
    device = _missing_device(text)
    if device is not None:
        return f"there is no {device}: is the camera plugged in?"
    return "cannot be opened: is it plugged in, may this user read it, and is no other program using it?"


def _request(capture: cv2.VideoCapture, rate_hz: float, size_px: Size | None) -> None:
    """Ask a webcam for size and rate; not all can do it, and the pictures show what it chose."""
    if size_px is not None:
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, size_px[0])
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, size_px[1])
    capture.set(cv2.CAP_PROP_FPS, rate_hz)
