"""A network camera (MJPEG over HTTP, read by OpenCV): killed and restarted, with a password."""

import http.server
import socketserver
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from camera_stage import WAIT_S, FrameReader
from processes import within

from observer.camera.base import CameraFault
from observer.camera.capture import connect
from observer.camera.live import LiveCamera
from observer.camera.opening import open_pictures

BETWEEN_S = 0.01
NOISE = [
    cv2.imencode(".jpg", np.random.default_rng(seed).integers(0, 255, (48, 64, 3), np.uint8))[1].tobytes()
    for seed in range(7)
]


class Stream(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        sent = 0
        try:
            while not self.server.ending.wait(BETWEEN_S):
                sent += 1
                picture = NOISE[sent % len(NOISE)]
                head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(picture)}\r\n\r\n"
                self.wfile.write(head.encode() + picture + b"\r\n")
        except OSError:
            pass  # the other side has gone

    def log_message(self, *args):
        pass


class Server(socketserver.ThreadingMixIn, http.server.HTTPServer):
    """Streams noise on a port until it leaves the block; then nobody listens there."""

    def __init__(self, port=0):
        self.ending = threading.Event()
        super().__init__(("127.0.0.1", port), Stream)
        self.thread = threading.Thread(target=self.serve_forever, kwargs={"poll_interval": 0.01})

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *error):
        self.close()

    def close(self):
        """As if its plug were pulled; a second time it changes nothing."""
        if not self.ending.is_set():
            self.ending.set()
            self.shutdown()
            self.thread.join(WAIT_S)
            self.server_close()


def viewer(port):
    address = f"http://me:s3cret@127.0.0.1:{port}/video?key=s3cret"
    return FrameReader(lambda report: open_pictures(address, Path(), report=report))


def name_at(port):
    return f"http://127.0.0.1:{port}/..."


def test_a_stream_that_dies_and_comes_back(caplog):
    with Server() as server:
        port = server.server_port
        with viewer(port) as reader:
            frame = reader.next_frame()
            assert frame.content.shape == (48, 64, 3) and frame.content.dtype == np.uint8
            assert 0 <= time.time_ns() - frame.captured_ns < WAIT_S * 1e9
            with within(1.0):
                server.close()
                state, reason = reader.next_report()
            assert state == "degraded" and reason.startswith(f"{name_at(port)}: ")
            with Server(port):
                assert reader.wait_for_report("running") == ("running", "")
                reader.next_frame()
    assert "s3cret" not in caplog.text + reason and name_at(port) in caplog.text


def test_an_address_without_a_camera_says_what_to_check():
    with Server() as server:
        port = server.server_port
    with pytest.raises(CameraFault, match="does not answer, or sends no video: is it on"):
        connect(f"http://127.0.0.1:{port}/video", 30)


def test_stopping_does_not_wait_for_an_absent_camera():
    stop = threading.Event()

    def away():
        stop.set()
        raise CameraFault("away")

    with within(2.0):
        assert list(LiveCamera("cam", away).frames(stop)) == []
