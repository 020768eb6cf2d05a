"""The contract of frame sources, checked for each one."""

import io
import json
import threading
from dataclasses import replace
from itertools import islice, pairwise

import cv2
import numpy as np
import pytest

from common import SECOND_NS
from observer.camera.live import LatestFrame
from observer.camera.opening import open_pictures
from observer.foreign import LineTracks, PipedTracks
from observer.geometry.views import parse_view
from observer.motion.archive import Recording
from observer.motion.playback import FRAME_LATE_S, RecordedMotion
from observer.rendering.virtual_camera import VirtualCamera
from observer.runtime.scene_inputs import UnmirroredSource
from observer.tracks import BODY_PARTS

FRAMES, RATE = 6, 50.0


def motion(speed=0.0, frames=FRAMES):
    positions = np.repeat([[[-0.3, 0.9, 0], [0.3, 0.9, 0], [0, 1.65, 0]]], frames, axis=0).astype(np.float32)
    return RecordedMotion(BODY_PARTS, (Recording(positions, RATE, "rest", "1", "1"),), speed)


def virtual(motion):
    return VirtualCamera(motion, parse_view("door"), (64, 48))


def album(folder, speed=0.0, frames=FRAMES):
    for n in range(frames):
        cv2.imwrite(str(folder / f"{n:03}.png"), np.full((48, 64, 3), 5 * n, np.uint8))
    return open_pictures(str(folder), folder, rate_hz=RATE, speed=speed)


def video(folder, speed=0.0, frames=FRAMES):
    path = folder / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), RATE, (64, 48))
    for n in range(frames):
        writer.write(np.full((48, 64, 3), 5 * n, np.uint8))
    writer.release()
    return open_pictures("clip.avi", folder, speed=speed)


def piped(_folder):
    lines = [json.dumps({"captured_ns": n + 1, "parts": {"head": [n, 1]}}).encode() for n in range(FRAMES)]
    return PipedTracks(io.BytesIO(b"\n".join(lines)), LineTracks("pipe"))


SOURCES = {
    "motion": lambda _folder: motion(),
    "virtual camera": lambda _folder: virtual(motion()),
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


class Time:
    """A clock that waiting moves, and the observer, which takes INTERVALS for each frame; the stop event at once."""

    def __init__(self):
        self.now_ns = self.began_ns = 1_000 * SECOND_NS

    def __call__(self):
        return self.now_ns

    def is_set(self):
        return False

    def wait(self, seconds):
        self.now_ns += round(seconds * SECOND_NS)


MANY, INTERVALS = 40, 3


def arrivals(time):
    """(number, arrival) of MANY pictures or lines, each when it has arrived; waits for the next if there is none."""
    sent = 0
    while sent < MANY:
        if (due_ns := time.began_ns + round(sent * SECOND_NS / RATE)) > time():
            yield None
            time.now_ns = max(time(), due_ns)
        yield sent, due_ns
        sent += 1


def lines(time):
    """Lines from another program, of which those that have arrived are taken together."""
    coming = arrivals(time)

    def take(_timeout_s):
        taken = [
            (json.dumps({"captured_ns": at_ns, "parts": {"head": [n, 1]}}).encode(), at_ns)
            for n, at_ns in iter(lambda: next(coming, None), None)
        ]
        return taken or (None if coming.gi_frame is None else [])

    return LineTracks("lines", clock=time).frames_of(take, time)


def camera(time):
    """A live camera, whose thread stores each picture when it comes."""
    coming, latest = arrivals(time), LatestFrame(time())
    while coming.gi_frame is not None:
        for n, at_ns in iter(lambda: next(coming, None), None):
            latest.put(at_ns, np.full((48, 64, 3), n, np.uint8), at_ns)
        frame, _ = latest.take(0)
        if frame is not None:
            yield frame


IN_TIME = {
    "motion": lambda _folder, time: replace(motion(1.0, MANY), clock=time).frames(time),
    "virtual camera": lambda _folder, time: virtual(replace(motion(1.0, MANY), clock=time)).frames(time),
    "mirrored": lambda folder, time: UnmirroredSource(replace(album(folder, 1.0, MANY), clock=time)).frames(time),
    "folder": lambda folder, time: replace(album(folder, 1.0, MANY), clock=time).frames(time),
    "video": lambda folder, time: replace(video(folder, 1.0, MANY), clock=time).frames(time),
    "lines": lambda _folder, time: lines(time),
    "live camera": lambda _folder, time: camera(time),
}


@pytest.mark.parametrize("name", IN_TIME)
def test_an_observer_that_is_too_slow_gets_the_newest_frame(name, tmp_path):
    time, captured_ns, skipped = Time(), [], 0
    for frame in IN_TIME[name](tmp_path, time):
        assert 0 <= time() - frame.captured_ns <= (FRAME_LATE_S + INTERVALS / RATE) * SECOND_NS
        captured_ns.append(frame.captured_ns)
        skipped += frame.skipped
        time.now_ns += round(INTERVALS * SECOND_NS / RATE)
    assert all(a < b for a, b in pairwise(captured_ns))
    assert captured_ns[-1] == time.began_ns + round((MANY - 1) * SECOND_NS / RATE)
    assert len(captured_ns) + skipped == MANY and skipped > MANY / 2
