"""A live camera that fails, freezes and returns: its frames and its reports."""

import itertools
import threading
import time

import numpy as np
import pytest
from camera_stage import WAIT_S, FrameReader
from observer_stage import rejected
from processes import within

from common.backoff import Backoff
from common.errors import LabanmeshError
from observer.camera.base import CameraFault
from observer.camera.live import CameraTimeouts, LiveCamera

SOON = Backoff(first_s=0.01, longest_s=0.02)
SHORT = CameraTimeouts(silence_s=0.3, same_s=0.05)


def picture(number, size_px=(16, 8)):
    shape = (size_px[1], size_px[0], 3)
    return np.full(shape, 0, np.uint8) + np.frombuffer(number.to_bytes(3, "big"), np.uint8)


def number_of(frame):
    return int.from_bytes(frame.content[0, 0].tobytes(), "big")


class FakeCamera:
    """Delivers numbered pictures every 2 ms; `mode` is what it does meanwhile; counts how often it was opened."""

    def __init__(self):
        self.mode, self.size_px = "works", (16, 8)
        self.numbers = itertools.count()
        self.opened = self.closed = self.reads = self.last = 0
        self.tick = threading.Event()  # never set: waiting for it is the camera's rate
        self.released = threading.Event()

    def connect(self):
        if self.mode == "away":
            raise CameraFault("cannot be opened")
        self.opened += 1
        return self

    def read(self):
        self.tick.wait(0.002)
        self.reads += 1
        if self.mode == "broken":
            raise ZeroDivisionError
        if self.mode in ("away", "fails"):
            raise CameraFault("delivers no more pictures")
        if self.mode == "hangs":
            self.released.wait(WAIT_S)
        if self.mode != "frozen":
            self.last = next(self.numbers)
        return time.time_ns(), picture(self.last, self.size_px)

    def close(self):
        self.closed += 1

    def wait_for_reads(self, more):
        target = self.reads + more
        while self.reads < target:
            self.tick.wait(0.002)


def reader_of(camera, **arguments):
    options = {"timeouts": SHORT, "backoff": SOON, **arguments}
    return FrameReader(lambda report: LiveCamera("cam", camera.connect, report, **options))


def test_a_slow_observer_always_gets_the_newest_and_none_twice():
    camera = FakeCamera()
    stop = threading.Event()
    source = LiveCamera("cam", camera.connect, timeouts=CameraTimeouts(same_s=WAIT_S, silence_s=WAIT_S))
    captured = []
    for frame in source.frames(stop):
        captured.append((frame.captured_ns, number_of(frame)))
        assert abs(camera.last - number_of(frame)) <= 5, "frames were queued"
        camera.wait_for_reads(10)  # the observer is slow
        if len(captured) == 5:
            stop.set()
    assert captured == sorted(set(captured))
    assert all(b[1] - a[1] >= 5 for a, b in itertools.pairwise(captured))
    assert camera.closed == camera.opened == 1


def test_absence_at_the_start_loss_and_return_are_reported_once():
    camera = FakeCamera()
    camera.mode = "away"
    with reader_of(camera) as reader:
        assert reader.next_report() == ("degraded", "cam: cannot be opened")
        camera.mode = "works"
        assert reader.next_report() == ("running", "")
        reader.next_frame()
        assert reader.reports.empty(), "nothing is reported of a camera that works"
        camera.mode = "away"
        assert reader.next_report() == ("degraded", "cam: delivers no more pictures")
        assert reader.next_report() == ("degraded", "cam: cannot be opened")
        camera.mode = "works"
        assert reader.next_report() == ("running", "")
        reader.next_frame()
    assert camera.opened == camera.closed == 2
    assert reader.reports.empty(), "each change is reported once"


def test_the_wait_grows_with_each_failure_in_a_row():
    stop, failure_counts = threading.Event(), []

    class RecordingBackoff(Backoff):
        def wait_s(self, failures):
            failure_counts.append(failures)
            if failures == 4:
                stop.set()
            return 0.001

    camera = FakeCamera()
    camera.mode = "away"
    assert list(LiveCamera("cam", camera.connect, backoff=RecordingBackoff(0.25, 8.0, 2.0)).frames(stop)) == []
    assert failure_counts[:4] == [1, 2, 3, 4]


@pytest.mark.parametrize(
    ("mode", "reason"), [("fails", "cam: delivers no more pictures"), ("hangs", "cam: no picture for 0.9 s")]
)
def test_a_loss_is_reported_within_a_second_by_default(mode, reason):
    camera = FakeCamera()
    with reader_of(camera, timeouts=CameraTimeouts()) as reader:
        reader.next_frame()
        with within(1.0):
            camera.mode = mode
            report = reader.next_report()
        assert report == ("degraded", reason)
        camera.mode = "works"
        camera.released.set()
        assert reader.next_report() == ("running", "")


def test_a_frozen_picture_is_reported_and_not_passed_on_until_it_moves():
    camera = FakeCamera()
    with reader_of(camera) as reader:
        reader.next_frame()
        camera.mode = "frozen"
        assert reader.next_report() == ("degraded", "cam: frozen: the same picture for 0.05 s")
        reader.frames.queue.clear()
        camera.wait_for_reads(20)
        assert reader.frames.empty()
        camera.mode = "works"
        assert reader.next_report() == ("running", "")
        assert number_of(reader.next_frame()) > 0
    assert camera.opened == 1


def test_pictures_of_another_size_are_a_reported_fault():
    camera = FakeCamera()
    with reader_of(camera, size_px=(16, 8)) as reader:
        reader.next_frame()
        camera.size_px = (8, 8)
        assert reader.next_report() == ("degraded", "cam: delivers 8x8 px, not 16x8 as before or as calibrated")
        camera.size_px = (16, 8)
        assert reader.next_report() == ("running", "")


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_an_unexpected_error_in_the_thread_ends_the_source():
    camera = FakeCamera()
    camera.mode = "broken"
    with rejected("cam: the thread", error=LabanmeshError):
        list(LiveCamera("cam", camera.connect).frames(threading.Event()))
    assert camera.closed == 1
