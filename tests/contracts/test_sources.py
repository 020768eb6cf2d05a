"""The contract of frame sources, checked for each one."""

import io
import json
import threading
from itertools import islice, pairwise

import cv2
import numpy as np
import pytest

from observer.camera.opening import open_pictures
from observer.foreign.sources import LineTracks, PipedTracks
from observer.geometry.views import parse_view
from observer.motion.archive import Recording
from observer.motion.playback import RecordedMotion
from observer.rendering.virtual_camera import VirtualCamera
from observer.runtime.scene_inputs import UnmirroredSource
from observer.tracks import BODY_PARTS

FRAMES, RATE = 6, 50.0


def motion(speed=0.0):
    positions = np.repeat([[[-0.3, 0.9, 0], [0.3, 0.9, 0], [0, 1.65, 0]]], FRAMES, axis=0).astype(np.float32)
    return RecordedMotion(BODY_PARTS, (Recording(positions, RATE, "rest", "1", "1"),), speed)


def album(folder):
    for n in range(FRAMES):
        cv2.imwrite(str(folder / f"{n:03}.png"), np.full((48, 64, 3), 20 * n, np.uint8))
    return open_pictures(str(folder), folder, rate_hz=RATE, speed=0)


def video(folder):
    path = folder / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), RATE, (64, 48))
    for n in range(FRAMES):
        writer.write(np.full((48, 64, 3), 20 * n, np.uint8))
    writer.release()
    return open_pictures("clip.avi", folder, speed=0)


def piped(_folder):
    lines = [json.dumps({"captured_ns": n + 1, "parts": {"head": [n, 1]}}).encode() for n in range(FRAMES)]
    return PipedTracks(io.BytesIO(b"\n".join(lines)), LineTracks("pipe"))


SOURCES = {
    "motion": lambda _folder: motion(),
    "motion in time": lambda _folder: motion(1.0),
    "virtual camera": lambda _folder: VirtualCamera(motion(), parse_view("door"), (64, 48)),
    "mirrored": lambda folder: UnmirroredSource(album(folder)),
    "folder": album,
    "video": video,
    "pipe": piped,
}


@pytest.fixture(params=SOURCES)
def source(request, tmp_path):
    return SOURCES[request.param](tmp_path)


def test_all_frames_come_in_order(source):
    frames = list(source.frames(threading.Event()))
    assert len(frames) == FRAMES and source.rate_hz > 0
    assert all(a.captured_ns <= b.captured_ns for a, b in pairwise(frames))
    assert all(a.at_ns < b.at_ns for a, b in pairwise(frames))


def test_it_ends_soon_after_stop(source):
    stop = threading.Event()
    frames = source.frames(stop)
    assert len(list(islice(frames, 2))) == 2
    stop.set()
    assert len(list(frames)) <= 1


def test_content_is_a_picture_or_rows(source):
    for frame in source.frames(threading.Event()):
        if frame.content.ndim == 3:
            assert frame.content.dtype == np.uint8 and frame.content.shape[2] == 3
        else:
            assert frame.content.shape == (len(source.body_parts), 3)
