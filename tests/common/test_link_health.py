"""What a process says of itself."""

from common import SECOND_NS
from common.status import ProcessStatus

START_NS = 1_000 * SECOND_NS


def test_it_starts_with_nothing_seen():
    status = ProcessStatus("dojo", "cam1").status(START_NS)
    assert (status.scene, status.id, status.state, status.rate_hz) == ("dojo", "cam1", "starting", 0)
    assert status.last_frame_ns is None and status.version


def test_rate_and_newest_frame():
    health = ProcessStatus("dojo", "cam1")
    health.set_state("running")
    for i in range(60):
        health.record_frame(START_NS + i, START_NS + i * SECOND_NS // 15)
    status = health.status(START_NS + 59 * SECOND_NS // 15)
    assert 15 <= status.rate_hz <= 15.5
    assert (status.state, status.last_frame_ns) == ("running", START_NS + 59)


def test_a_late_frame_is_not_the_newest():
    health = ProcessStatus("dojo", "cam1")
    health.record_frame(START_NS, START_NS)
    health.record_frame(START_NS - 5, START_NS)
    assert health.status(START_NS).last_frame_ns == START_NS


def test_running_without_frames_is_degraded_and_recovers():
    health = ProcessStatus("dojo", "cam1", silence_s=2)
    health.set_state("running")
    assert health.status(START_NS).state == "running"
    health.record_frame(START_NS, START_NS)
    assert health.status(START_NS + 2 * SECOND_NS).state == "running"
    silent = health.status(START_NS + 5 * SECOND_NS)
    assert (silent.state, silent.reason, silent.rate_hz) == ("degraded", "no frame for 5 s", 0)
    health.record_frame(START_NS + 6 * SECOND_NS, START_NS + 6 * SECOND_NS)
    assert health.status(START_NS + 6 * SECOND_NS).state == "running"


def test_frames_of_a_wrong_clock_are_not_silence():
    health = ProcessStatus("dojo", "fusion")
    health.set_state("running")
    health.record_frame(START_NS - 3600 * SECOND_NS, START_NS)
    assert health.status(START_NS).state == "running"


def test_stopping_is_not_degraded():
    health = ProcessStatus("dojo", "cam1")
    health.record_frame(START_NS, START_NS)
    health.set_state("stopping", "told to")
    status = health.status(START_NS + 60 * SECOND_NS)
    assert (status.state, status.reason) == ("stopping", "told to")
