"""Posteriors that arrive together are judged together."""

import pytest

from common.inbox import Arrival
from fusion.server import LOT_NS, LotSize

MS = 1_000_000


def arrivals(at_ms, *observers):
    return [Arrival(f"laban/hall/observer/{name}/posterior", b"", round(at_ms * MS)) for name in observers]


@pytest.fixture
def lots():
    return LotSize()


def test_the_first_of_a_frame_waits_for_as_many_as_the_last_frame_had(lots):
    lots.add(arrivals(100, "a", "b"))
    lots.add(arrivals(100.1, "c"))
    assert not lots.missing
    lots.add(arrivals(116, "b"))
    assert lots.missing
    lots.add(arrivals(116.1, "a"))
    assert lots.missing
    lots.add(arrivals(116.2, "c"))
    assert not lots.missing


def test_cameras_out_of_step_are_never_waited_for(lots):
    for at_ms in range(100, 200, 8):
        lots.add(arrivals(at_ms, "a"))
        assert not lots.missing
        lots.add(arrivals(at_ms + 4, "b"))
        assert not lots.missing


def test_an_observer_that_is_gone_is_waited_for_once(lots):
    lots.add(arrivals(100, "a", "b", "c"))
    lots.add(arrivals(116, "a", "b"))
    assert lots.missing
    lots.add(arrivals(132, "a", "b"))
    assert not lots.missing


def test_a_clock_that_was_set_back_begins_a_new_lot(lots):
    lots.add(arrivals(100, "a", "b"))
    lots.add(arrivals(50, "a"))
    assert lots.missing
    lots.add(arrivals(50 + LOT_NS / MS, "a"))
    assert not lots.missing
