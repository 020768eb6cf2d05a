"""The pictures of one camera, read from a video, a picture or a folder; and the annotated picture of a calibration."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.camera.capture import silence_opencv
from observer.camera.files import read_picture
from observer.geometry.projection import Floats

Picture = NDArray[np.uint8]

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")


def pictures(source: Path, every: int = 1) -> Iterator[tuple[int, str, Picture]]:
    """Number from 0, label and (H, W, 3) BGR of each `every`-th picture; raises BadInput for an unreadable source."""
    if source.is_dir():
        files = sorted(file for file in source.iterdir() if file.suffix.lower() in PICTURES)
        if not files:
            raise BadInput(f"{source}: no pictures in this folder ({', '.join(PICTURES)})")
        yield from ((n, file.name, read_picture(file)) for n, file in enumerate(files) if n % every == 0)
    elif not source.exists():
        raise BadInput(f"{source}: no such file; give a video, a picture or a folder of pictures for each camera")
    elif source.suffix.lower() in PICTURES:
        yield 0, source.name, read_picture(source)
    else:
        yield from _video(source, every)


def is_video(source: Path) -> bool:
    """Whether the source is a video, whose pictures follow each other closely."""
    return not source.is_dir() and source.suffix.lower() not in PICTURES


def _video(path: Path, every: int) -> Iterator[tuple[int, str, Picture]]:
    silence_opencv()
    video, number = cv2.VideoCapture(str(path)), 0
    try:
        while video.grab():
            good, picture = video.retrieve() if number % every == 0 else (False, None)
            if good and picture is not None:
                yield number, f"frame {number}", picture.astype(np.uint8, copy=False)
            number += 1
    finally:
        video.release()
    if number == 0:
        raise BadInput(f"{path}: not a video that OpenCV can read; convert it, e.g. to .mp4 with H.264")


DETECTED, PROJECTED, TEXT = (80, 220, 0), (0, 0, 255), (255, 255, 255)
"""Green rings, red crosses, white text (BGR)."""


def annotated(picture: Picture, detected: Floats, projected: Floats, text: str) -> Picture:
    """(H, W, 3), (N, 2) detected and (N, 2) projected corners -> a copy with rings, crosses and a line of text."""
    result = picture.copy()
    size = max(4, picture.shape[1] // 160)
    for u, v in np.round(detected).astype(int).tolist():
        cv2.circle(result, (u, v), size, DETECTED, 2, cv2.LINE_AA)
    for u, v in np.round(projected[np.isfinite(projected).all(axis=1)]).astype(int).tolist():
        cv2.drawMarker(result, (u, v), PROJECTED, cv2.MARKER_CROSS, size, 1, cv2.LINE_AA)
    scale = max(0.5, picture.shape[1] / 1600)
    for colour, width in (((0, 0, 0), 4), (TEXT, 1)):
        cv2.putText(result, text, (10, int(40 * scale)), cv2.FONT_HERSHEY_SIMPLEX, scale, colour, width, cv2.LINE_AA)
    return result
