"""Cameras by OpenCV: open one, take the next picture, and keep OpenCV and FFmpeg from talking to the terminal."""

import os
import time
from collections.abc import Callable
from typing import Protocol, cast

import cv2

from observer.camera.base import CameraFault, Clock, Picture, Size, kind_of

OPEN_TIMEOUT_MS = 2000
"""For the answer of a camera in the network."""
READ_TIMEOUT_MS = 1000
"""For its next picture; then the stream is opened again."""


class Camera(Protocol):
    """An open camera, used by one thread."""

    def read(self) -> tuple[int, Picture]:
        """When it was captured (Unix epoch, ns) and the next picture; waits for it. CameraFault when none comes."""

    def close(self) -> None:
        """Gives the device or the connection back."""


_SILENT = 0  # OpenCV's LOG_LEVEL_SILENT

Connect = Callable[[], Camera]
"""Opens the camera; CameraFault when that does not succeed now."""


def be_quiet() -> None:
    """Nothing of OpenCV or FFmpeg on stderr, unless the environment asks for it; FFmpeg if it was not used before."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    if "OPENCV_LOG_LEVEL" not in os.environ:
        # OpenCV 4.11 has the first, 4.14 the second.
        set_level = getattr(cv2, "setLogLevel", None) or cv2.utils.logging.setLogLevel
        set_level(_SILENT)


class OpenCvCamera:
    """A camera that OpenCV has opened."""

    def __init__(self, capture: cv2.VideoCapture, clock: Clock = time.time_ns) -> None:
        self._capture, self._clock = capture, clock

    def read(self) -> tuple[int, Picture]:
        """The next picture, stamped when OpenCV had grabbed it and before it is unpacked."""
        try:
            grabbed = self._capture.grab()
            captured_ns = self._clock()
            good, picture = self._capture.retrieve() if grabbed else (False, None)
        except cv2.error as error:
            raise CameraFault(f"delivers no more: {error.err}") from None
        if not good or picture is None or picture.size == 0:
            raise CameraFault("delivers no more pictures")
        return captured_ns, cast("Picture", picture)

    def close(self) -> None:
        """Releases the device or the connection."""
        self._capture.release()


def connect(text: str, rate_hz: float, size_px: Size | None = None) -> OpenCvCamera:
    """Opens the camera "0", "/dev/video0" or at an address; a webcam is asked for the rate and the size.

    Raises CameraFault when it cannot be opened.
    """
    be_quiet()
    kind = kind_of(text)
    try:
        capture = _from_network(text) if kind == "url" else _from_device(text, kind == "index")
        if not capture.isOpened():
            raise CameraFault(_WHY[kind == "url"])
        if kind != "url":
            _ask(capture, rate_hz, size_px)
    except cv2.error:
        raise CameraFault(_WHY[kind == "url"]) from None
    return OpenCvCamera(capture)


_WHY = {
    True: "does not answer, or sends no video: is it on, in this network, and are its address and password right?",
    False: "cannot be opened: is it plugged in, may this user read it, and does no other program hold it?",
}


def _from_network(address: str) -> cv2.VideoCapture:
    limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, OPEN_TIMEOUT_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, READ_TIMEOUT_MS]
    return cv2.VideoCapture(address, cv2.CAP_FFMPEG, limits)


def _from_device(text: str, by_index: bool) -> cv2.VideoCapture:
    return cv2.VideoCapture(int(text)) if by_index else cv2.VideoCapture(text, cv2.CAP_V4L2)


def _ask(capture: cv2.VideoCapture, rate_hz: float, size_px: Size | None) -> None:
    """What the camera makes of it shows in its pictures; not all can do it."""
    if size_px is not None:
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, size_px[0])
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, size_px[1])
    capture.set(cv2.CAP_PROP_FPS, rate_hz)
