"""Numbered pictures, a video of them, and a reader of a source in a thread."""

import queue
import threading
import time

import cv2
import numpy as np

WAIT_S = 30


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


class FrameReader:
    """Takes frames as an observer does; frames and reports can be waited for. open_source: makes the source, from the
    function that gets its reports."""

    def __init__(self, open_source):
        self.reports, self.frames, self.stop = queue.Queue(), queue.Queue(), threading.Event()
        source = open_source(lambda *report: self.reports.put(report))
        self.thread = threading.Thread(target=lambda: [self.frames.put(frame) for frame in source.frames(self.stop)])

    def next_report(self):
        return self.reports.get(timeout=WAIT_S)

    def wait_for_report(self, state):
        """Wait until this state is reported, whatever is reported before it."""
        while (report := self.next_report())[0] != state:
            pass
        return report

    def next_frame(self):
        """One that is captured after now."""
        now_ns = time.time_ns()
        while (frame := self.frames.get(timeout=WAIT_S)).captured_ns < now_ns:
            pass
        return frame

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *error):
        self.stop.set()
        self.thread.join(WAIT_S)
        assert not self.thread.is_alive()
