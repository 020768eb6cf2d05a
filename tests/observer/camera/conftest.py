"""Small real videos, written by OpenCV."""

import os

import pytest

# Before FFmpeg is first used, by whichever test that is: it reads this once.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

import cv2
import numpy as np


def numbered(number, size_px=(64, 48)):
    """A picture of one grey, 10 per number: compression keeps that apart."""
    return np.full((size_px[1], size_px[0], 3), 10 * number, np.uint8)


def write_video(path, count=12, rate_hz=25.0, size_px=(64, 48)):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), rate_hz, size_px)
    assert writer.isOpened()
    for number in range(count):
        writer.write(numbered(number, size_px))
    writer.release()
    return path


@pytest.fixture(scope="session")
def video(tmp_path_factory):
    """clip.avi: 12 pictures of 64x48 at 25 Hz, MJPG."""
    return write_video(tmp_path_factory.mktemp("video") / "clip.avi")
