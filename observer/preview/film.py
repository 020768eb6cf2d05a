"""A film of pictures, complete or absent."""

from pathlib import Path

import cv2

from common.errors import BadInput
from observer.camera.capture import silence_opencv
from observer.preview.sight import Picture


class Film:
    """A video file (.mp4) of pictures of one size, written under a temporary name until it is closed.

    size_px: width and height. Raises BadInput when it cannot be written.
    """

    def __init__(self, path: Path, rate_hz: float, size_px: tuple[int, int]) -> None:
        self._path, self._partial = path, path.with_name(f"{path.stem}.part{path.suffix}")
        silence_opencv()
        codec = cv2.VideoWriter.fourcc(*"mp4v")
        self._writer = cv2.VideoWriter(str(self._partial.absolute()), cv2.CAP_FFMPEG, codec, rate_hz, size_px)
        if not self._writer.isOpened():
            raise BadInput(f"cannot write {path}, or this OpenCV makes no such film at {rate_hz:g} Hz")

    def draw(self, picture: Picture) -> None:
        """Write one more picture."""
        self._writer.write(picture)

    def close(self) -> None:
        """Give the file its name."""
        self._writer.release()
        self._partial.replace(self._path)
