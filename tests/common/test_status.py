"""The status of a process, and its health."""

import pytest

from common import SECOND_NS
from common.health import FRESH_S, STALLED_S, ProcessHealth
from common.messages import StatusMessage
from common.status import ProcessStatus
from common.wire import decode, encode

START_NS = 1_000 * SECOND_NS


@pytest.fixture
def status():
    status = ProcessStatus("dojo", "cam1", silence_s=2)
    status.set_state("running")
    return status


def test_rate_and_newest_frame(status):
    for i in range(60):
        status.record_frame(START_NS + i, START_NS + i * SECOND_NS // 15)
    status.record_frame(START_NS - 5, START_NS + 59 * SECOND_NS // 15)
    status.clock_skew_s = 0.5
    message = status.status(START_NS + 59 * SECOND_NS // 15)
    assert (message.id, message.skew_s, message.at_ns) == ("cam1", 0.5, START_NS + 59 * SECOND_NS // 15)
    assert 15 <= message.rate_hz <= 16
    assert (message.state, message.last_frame_ns) == ("running", START_NS + 59)


def test_a_process_without_frames_is_degraded_and_recovers(status):
    assert status.status(START_NS).state == "running"
    # A wrong clock of the camera is not silence.
    status.record_frame(START_NS - 3600 * SECOND_NS, START_NS)
    assert status.status(START_NS + 2 * SECOND_NS).state == "running"
    silent = status.status(START_NS + 5 * SECOND_NS)
    assert (silent.state, silent.reason, silent.rate_hz) == ("degraded", "no frame for 5 s", 0)
    status.record_frame(START_NS, START_NS + 6 * SECOND_NS)
    assert status.status(START_NS + 6 * SECOND_NS).state == "running"
    status.set_state("stopping", "x" * 100_000)
    stopping = status.status(START_NS + 60 * SECOND_NS)
    assert stopping.state == "stopping" and decode(StatusMessage, encode(stopping)).reason == "x" * 200


def test_alive_and_ready_follow_the_steps_of_the_loop():
    notes = []
    health = ProcessHealth("dojo", "observer", "cam1", 100.0, note=lambda: notes[-1] if notes else "")
    assert health.alive(101).ok and not health.ready(101).ok and health.ready(101).reason == "no frame yet"
    assert health.alive(100 + STALLED_S).reason == f"no frame for {STALLED_S:.0f} s"
    health.record_step(110)
    assert health.ready(110 + FRESH_S - 0.1).ok and health.ready(111).reason == ""
    assert not health.ready(110 + FRESH_S).ok and health.alive(110 + FRESH_S).ok
    assert not health.alive(110 + STALLED_S).ok
    notes.append("camera 0: no picture")
    assert health.ready(120).reason == "camera 0: no picture"
    health.record_step(120)
    assert health.ready(121).ok and health.ready(121).reason == "camera 0: no picture"
    health.set_obstacle("the broker: refused")
    assert health.ready(121) != health.alive(121) and health.ready(121).reason == "the broker: refused"
    health.set_obstacle("")
    assert health.ready(121).ok
