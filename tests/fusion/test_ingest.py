"""What is read of a flood, and how rejected messages are counted and logged."""

from hypothesis import example, given
from hypothesis import strategies as st

from common import MINUTE_NS
from common.inbox import Arrival
from fusion.ingest import FLOOD, NEWEST, RejectionLog, newest


@given(st.lists(st.sampled_from("abcde"), max_size=300))
@example(list("abc" * FLOOD))
def test_of_a_flood_the_newest_of_each_key_are_read_in_order(keys):
    arrivals = [Arrival(key, b"", n) for n, key in enumerate(keys)]
    read = newest(arrivals)
    if len(arrivals) <= FLOOD:
        assert read == arrivals
        return
    assert read == sorted(read, key=lambda arrival: arrival.arrived_ns)
    for key in set(keys):
        assert [a for a in read if a.key == key] == [a for a in arrivals if a.key == key][-NEWEST:]


def test_rejections_are_logged_once_a_minute_per_sender():
    rejections = RejectionLog()
    line = rejections.add("cam1", "malformed", "d", 0)
    assert line == "cam1: messages rejected since the last line: malformed 1; newest: d"
    assert rejections.add("cam1", "malformed", "d", MINUTE_NS - 1) is None
    assert rejections.add("cam2", "malformed", "d", 1) is not None
    assert "malformed 1, not_finite 1; newest: e" in rejections.add("cam1", "not_finite", "e", MINUTE_NS)
    assert rejections.totals["cam1"] == {"malformed": 2, "not_finite": 1}


def test_invented_names_do_not_fill_the_memory():
    rejections = RejectionLog()
    lines = [rejections.add(f"x{i}", "malformed", "d", 0) for i in range(1000)]
    assert sum(line is not None for line in lines) == 257
    assert len(rejections.totals) == 257 and rejections.totals["others"]["malformed"] == 744
