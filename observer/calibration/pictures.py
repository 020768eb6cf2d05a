"""The pictures of one camera, read from a video, a picture or a folder; and the annotated picture of a calibration."""

import os
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput, LabanmeshError
from observer.geometry.projection import Floats

Picture = NDArray[np.uint8]

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")


def pictures(source: Path, every: int = 1) -> Iterator[tuple[int, str, Picture]]:
    """(number from 0, what to call it, (H, W, 3) BGR) of each `every`-th picture; raises BadInput for what is none."""
    if source.is_dir():
        files = sorted(file for file in source.iterdir() if file.suffix.lower() in PICTURES)
        if not files:
            raise BadInput(f"{source}: no pictures in this folder ({', '.join(PICTURES)})")
        yield from ((n, file.name, _picture(file)) for n, file in enumerate(files) if n % every == 0)
    elif not source.exists():
        raise BadInput(f"{source}: not there; give a video, a picture or a folder of pictures for each camera")
    elif source.suffix.lower() in PICTURES:
        yield 0, source.name, _picture(source)
    else:
        yield from _video(source, every)


def is_video(source: Path) -> bool:
    """Whether its pictures were taken one soon after the other."""
    return not source.is_dir() and source.suffix.lower() not in PICTURES


def write_picture(path: Path, picture: Picture) -> None:
    """Write by the name's ending; raises LabanmeshError when the disk does not take it."""
    try:
        path.write_bytes(cv2.imencode(path.suffix, picture)[1].tobytes())
    except OSError as error:
        raise LabanmeshError(f"{path}: cannot be written: {error.strerror}") from None


def _picture(path: Path) -> Picture:
    # imread warns on stderr and returns None for whatever is wrong; from bytes it does not.
    content = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    picture = cv2.imdecode(content, cv2.IMREAD_COLOR) if len(content) else None
    if picture is None:
        raise BadInput(f"{path}: no picture that OpenCV can read; take it out or save it as .png")
    return picture.astype(np.uint8, copy=False)


def _video(path: Path, every: int) -> Iterator[tuple[int, str, Picture]]:
    # FFmpeg would tell its own story on stderr beside our one line.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    video, number = cv2.VideoCapture(str(path)), 0
    try:
        while video.grab():
            taken, picture = video.retrieve() if number % every == 0 else (False, None)
            if taken and picture is not None:
                yield number, f"frame {number}", picture.astype(np.uint8, copy=False)
            number += 1
    finally:
        video.release()
    if number == 0:
        raise BadInput(f"{path}: no video that OpenCV can read; convert it, e.g. to .mp4 with H.264")


FOUND, DRAWN, TEXT = (80, 220, 0), (0, 0, 255), (255, 255, 255)
"""Green rings, red crosses, white letters (BGR)."""


def annotated(picture: Picture, found: Floats, drawn: Floats, text: str) -> Picture:
    """(H, W, 3), (N, 2) corners found, (N, 2) corners projected -> a copy with rings, crosses and a line of text."""
    result = picture.copy()
    size = max(4, picture.shape[1] // 160)
    for u, v in np.round(found).astype(int).tolist():
        cv2.circle(result, (u, v), size, FOUND, 2, cv2.LINE_AA)
    for u, v in np.round(drawn[np.isfinite(drawn).all(axis=1)]).astype(int).tolist():
        cv2.drawMarker(result, (u, v), DRAWN, cv2.MARKER_CROSS, size, 1, cv2.LINE_AA)
    height = max(0.5, picture.shape[1] / 1600)
    for colour, width in (((0, 0, 0), 4), (TEXT, 1)):
        cv2.putText(result, text, (10, int(40 * height)), cv2.FONT_HERSHEY_SIMPLEX, height, colour, width, cv2.LINE_AA)
    return result
