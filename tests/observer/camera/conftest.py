"""A small real video, written by OpenCV."""

import os

import pytest

# Before FFmpeg is first used, by whichever test that is: it reads this once.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

from camera_stage import write_video


@pytest.fixture(scope="session")
def video(tmp_path_factory):
    """clip.avi: 12 pictures of 64x48 at 25 Hz, MJPG."""
    return write_video(tmp_path_factory.mktemp("video") / "clip.avi")
