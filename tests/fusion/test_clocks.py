"""The observers' clocks: one test a rule, and an observer whose clock lies in every way is as old as it really is."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.clock_skew import ClockReading
from common.messages import PosteriorMessage, VocabularyReference
from fusion.engine.clocks import UNNOTICED_NS, Clocks

MS, S = 1_000_000, 1_000_000_000
NOW = 100_000 * S
HOUR = 3600 * S
REFERENCE = VocabularyReference(name="m", hash="h")


def message(captured_ns, sent_ns, seq=0, session="a"):
    return PosteriorMessage(scene="dojo", observer="cam", seq=seq, session=session, captured_ns=captured_ns,
                            sent_ns=sent_ns, vocabulary=REFERENCE, p=[0.5, 0.5], frames=1)  # fmt: skip


def hear(clocks, said, now_ns):
    """What the referee does with a message that can be used."""
    found = clocks.captured_ns("cam", said, now_ns)
    clocks.heard("cam", said)
    return found


def asked(skew_ns, now_ns=NOW, way_ns=MS):
    return ClockReading(now_ns - 2 * way_ns, now_ns - way_ns + skew_ns, now_ns)


def test_a_right_clock_is_believed_to_the_nanosecond():
    clocks = Clocks(["cam"])
    clocks.read("cam", asked(UNNOTICED_NS - 1))
    assert clocks.captured_ns("cam", message(NOW - 30 * MS, NOW - 10 * MS), NOW) == NOW - 30 * MS


def test_what_the_measurement_cannot_tell_is_not_corrected():
    clocks = Clocks(["cam"])
    clocks.read("cam", asked(-80 * MS, way_ns=100 * MS))
    assert clocks.captured_ns("cam", message(NOW - 200 * MS, NOW - 180 * MS), NOW) == NOW - 200 * MS


@pytest.mark.parametrize("skew_ns", [HOUR, -HOUR, 300 * MS, -300 * MS])
def test_rule_1_a_measured_skew_is_taken_out(skew_ns):
    clocks = Clocks(["cam"])
    clocks.read("cam", asked(skew_ns))
    found = clocks.captured_ns("cam", message(NOW - 50 * MS + skew_ns, NOW - 20 * MS + skew_ns), NOW)
    assert found == pytest.approx(NOW - 50 * MS, abs=MS)
    assert clocks.skew_s("cam") == pytest.approx(skew_ns / S, abs=1e-3)


def test_rule_2_a_clock_ahead_that_was_never_asked_makes_nothing_fresh_for_ever():
    clocks = Clocks(["cam"])
    first = message(NOW + HOUR - 30 * MS, NOW + HOUR)
    assert clocks.captured_ns("cam", first, NOW) == NOW - 30 * MS


def test_rule_3_a_clock_that_stands_still_is_judged_by_the_arrival():
    clocks = Clocks(["cam"])
    for seq in range(5):
        now = NOW + seq * 33 * MS
        found = hear(clocks, message(NOW - 40 * MS, NOW, seq), now)
        assert found == now - 40 * MS


def test_rule_3_a_clock_set_back_is_doubted_until_it_was_asked():
    clocks = Clocks(["cam"])
    clocks.read("cam", asked(0))
    hear(clocks, message(NOW - 10 * MS, NOW, 0), NOW)
    for seq in (1, 2, 3):
        now = NOW + seq * 33 * MS
        assert hear(clocks, message(now - HOUR - 10 * MS, now - HOUR, seq), now) == now - 10 * MS
    clocks.read("cam", asked(-HOUR, now))
    now += 33 * MS
    found = clocks.captured_ns("cam", message(now - HOUR - 30 * MS, now - HOUR - 20 * MS, 4), now)
    assert found == pytest.approx(now - 30 * MS, abs=MS)


def test_rule_3_copies_and_stragglers_and_what_was_not_used_say_nothing_against_a_clock():
    clocks = Clocks(["cam"])
    for seq in (0, 1):
        hear(clocks, message(NOW + seq * MS - 10 * MS, NOW + seq * MS, seq), NOW + 5 * MS)
    for unused in (message(NOW, NOW, 1), message(NOW, NOW, 0), message(NOW, NOW + HOUR, 7), message(0, 0, 8)):
        clocks.captured_ns("cam", unused, NOW + 5 * MS)
    assert clocks.captured_ns("cam", message(NOW - 8 * MS, NOW + 2 * MS, 2), NOW + 5 * MS) == NOW - 8 * MS


def test_rule_4_what_was_captured_after_it_was_sent_was_captured_then():
    assert Clocks(["cam"]).captured_ns("cam", message(NOW + HOUR, NOW - 10 * MS), NOW) == NOW - 10 * MS


def test_a_delay_of_the_network_is_age():
    clocks = Clocks(["cam"])
    clocks.read("cam", asked(HOUR))
    captured = NOW - 5 * S
    found = clocks.captured_ns("cam", message(captured + HOUR, captured + HOUR + 10 * MS), NOW)
    assert found == pytest.approx(captured, abs=MS)


def test_strangers_are_not_remembered():
    clocks = Clocks(["cam"])
    clocks.read("zz", asked(HOUR))
    assert clocks.skew_s("zz") is None
    assert clocks.captured_ns("zz", message(5, 6), NOW) == 5


@given(
    skew_ns=st.integers(-2 * HOUR, 2 * HOUR),
    latency_ns=st.integers(0, 500 * MS),
    way_ns=st.integers(0, 50 * MS),
    back_ns=st.integers(0, 50 * MS),
)
def test_the_age_is_right_to_within_the_doubt_whatever_the_clock_shows(skew_ns, latency_ns, way_ns, back_ns):
    clocks = Clocks(["cam"])
    clocks.read("cam", ClockReading(NOW, NOW + way_ns + skew_ns, NOW + way_ns + back_ns))
    sent = NOW + S
    found = clocks.captured_ns("cam", message(sent - latency_ns + skew_ns, sent + skew_ns), sent + way_ns)
    doubt = max((way_ns + back_ns) // 2, UNNOTICED_NS)
    assert abs(found - (sent - latency_ns)) <= doubt + abs(way_ns - back_ns) + 1
