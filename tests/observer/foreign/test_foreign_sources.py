"""Foreign tracks on a stream and on a Zenoh key."""

import io
import json
import logging
import os
import threading

import pytest
from processes import SOON_S

from common.config import MeshConfig
from common.link import Link
from observer.foreign import LineTracks, MeshTracks, PipedTracks


def line(u):
    return json.dumps({"captured_ns": u + 1, "parts": {"head": [u, 2]}}).encode()


def test_a_stream_yields_one_frame_per_line_and_ends_at_its_end():
    source = PipedTracks(io.BytesIO(b"\n".join(line(u) for u in range(600))), LineTracks("pipe"))
    frames = list(source.frames(threading.Event()))
    assert [frame.content[2, 0] for frame in frames] == list(range(600))


def test_bad_lines_are_rejected_counted_and_logged_once(caplog):
    lines = LineTracks("pipe")
    with caplog.at_level(logging.WARNING):
        source = PipedTracks(
            io.BytesIO(b"\n".join([b"junk", line(1), b"", b"{}", line(2**64), line(10**400), line(2), b""])), lines
        )
        assert len(list(source.frames(threading.Event()))) == 2
    assert lines.rejected == 4
    assert len(caplog.records) == 1 and "pipe: rejected 1 line so far" in caplog.text


def test_silence_and_its_end_are_reported():
    reader, writer = os.pipe()
    reports, silent, speaking = [], threading.Event(), threading.Event()

    def report(state, reason):
        reports.append((state, reason))
        (silent if state == "degraded" else speaking).set()

    stop = threading.Event()
    stream = os.fdopen(reader, "rb")
    source = PipedTracks(stream, LineTracks("pipe", report))
    playing = threading.Thread(target=lambda: list(source.frames(stop)))
    playing.start()
    assert silent.wait(SOON_S)
    os.write(writer, line(1) + b"\n")
    assert speaking.wait(SOON_S)
    stop.set()
    playing.join(SOON_S)
    assert not playing.is_alive()
    os.close(writer)
    for thread in threading.enumerate():
        if thread.name == "tracks":
            thread.join(SOON_S)
    stream.close()
    assert reports[0] == ("degraded", "pipe: no tracks for 0.9 s; is the other tracker running?")
    assert reports[1] == ("running", "")


@pytest.fixture
def ends():
    mesh = MeshConfig(mode="process", endpoint="tcp/127.0.0.1:0")
    with (
        Link.open(mesh, "fusion", listen=["tcp/127.0.0.1:0"]) as here,
        Link.open(mesh.at(here.locator), "observer") as there,
    ):
        yield here, there


def test_a_zenoh_key_yields_one_frame_per_message(ends):
    here, there = ends
    source, stop = MeshTracks("tracks/cam1", LineTracks("zenoh:tracks/cam1")), threading.Event()
    source.listen(here)
    publisher = there.publisher("tracks/cam1")
    assert publisher.wait_for_subscriber(SOON_S)
    publisher.put(line(7))
    frame = next(source.frames(stop))
    assert frame.content[2].tolist() == [7, 2, 1]
