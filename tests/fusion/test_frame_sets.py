"""Posteriors that arrive together are judged together."""

import pytest

from common.inbox import Arrival
from fusion.server import FRAME_SET_NS, FrameSet

MS = 1_000_000


def arrivals(at_ms, *observers):
    return [Arrival(f"laban/hall/observer/{name}/posterior", b"", round(at_ms * MS)) for name in observers]


@pytest.fixture
def frame_set():
    return FrameSet()


def test_the_first_of_a_frame_waits_for_as_many_as_the_last_frame_had(frame_set):
    frame_set.add(arrivals(100, "a", "b"))
    frame_set.add(arrivals(100.1, "c"))
    assert not frame_set.missing
    frame_set.add(arrivals(116, "b"))
    assert frame_set.missing
    frame_set.add(arrivals(116.1, "a"))
    assert frame_set.missing
    frame_set.add(arrivals(116.2, "c"))
    assert not frame_set.missing


def test_cameras_out_of_step_are_never_waited_for(frame_set):
    for at_ms in range(100, 200, 8):
        frame_set.add(arrivals(at_ms, "a"))
        assert not frame_set.missing
        frame_set.add(arrivals(at_ms + 4, "b"))
        assert not frame_set.missing


def test_an_observer_that_is_gone_is_waited_for_once(frame_set):
    frame_set.add(arrivals(100, "a", "b", "c"))
    frame_set.add(arrivals(116, "a", "b"))
    assert frame_set.missing
    frame_set.add(arrivals(132, "a", "b"))
    assert not frame_set.missing


def test_a_clock_that_was_set_back_begins_a_new_set(frame_set):
    frame_set.add(arrivals(100, "a", "b"))
    frame_set.add(arrivals(50, "a"))
    assert frame_set.missing
    frame_set.add(arrivals(50 + FRAME_SET_NS / MS, "a"))
    assert not frame_set.missing
