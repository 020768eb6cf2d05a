"""An observer's clock: a test for each rule, and an observer with any clock is as old as it really is."""

import engine_stage
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common import SECOND_NS
from common.clock_skew import ClockReading
from fusion.engine.aged_posterior import IGNORED_SKEW_NS, ObserverClock

MS = 1_000_000
NOW = 100_000 * SECOND_NS
HOUR = 3600 * SECOND_NS


def message(captured_ns, sent_ns, seq=0):
    return engine_stage.message(captured_ns, sent_ns=sent_ns, seq=seq)


def use(clock, posterior, now_ns):
    """What the engine does with a message that it uses."""
    captured_ns = clock.captured_ns(posterior, now_ns)
    clock.record_message(posterior)
    return captured_ns


def reading(skew_ns, now_ns=NOW, way_ns=MS):
    return ClockReading(now_ns - 2 * way_ns, now_ns - way_ns + skew_ns, now_ns)


def clock_with(*readings):
    clock = ObserverClock()
    for one in readings:
        clock.record_reading(one)
    return clock


@pytest.mark.parametrize(("skew_ns", "way_ns"), [(IGNORED_SKEW_NS - 1, MS), (-80 * MS, 100 * MS)])
def test_rule_1_a_skew_within_the_uncertainty_is_not_corrected(skew_ns, way_ns):
    clock = clock_with(reading(skew_ns, way_ns=way_ns))
    assert clock.captured_ns(message(NOW - 200 * MS, NOW - 180 * MS), NOW) == NOW - 200 * MS


@pytest.mark.parametrize("skew_ns", [HOUR, -HOUR, 300 * MS, -300 * MS])
@pytest.mark.parametrize("delay_ns", [50 * MS, 5 * SECOND_NS])
def test_rule_1_a_measured_skew_is_corrected_and_a_network_delay_is_age(skew_ns, delay_ns):
    clock, captured_ns = clock_with(reading(skew_ns)), NOW - delay_ns
    corrected_ns = clock.captured_ns(message(captured_ns + skew_ns, captured_ns + 10 * MS + skew_ns), NOW)
    assert corrected_ns == pytest.approx(captured_ns, abs=MS)
    assert clock.skew_s == pytest.approx(skew_ns / SECOND_NS, abs=1e-3)


@pytest.mark.parametrize("shown", [lambda now_ns: NOW, lambda now_ns: now_ns - HOUR], ids=["stands still", "set back"])
def test_rule_3_a_wrong_clock_is_doubted_and_the_arrival_counts_until_it_is_read_again(shown):
    clock = clock_with(reading(0))
    use(clock, message(NOW - 10 * MS, NOW, 0), NOW)
    for seq in (1, 2, 3):
        now_ns = NOW + seq * 33 * MS
        assert use(clock, message(shown(now_ns) - 10 * MS, shown(now_ns), seq), now_ns) == now_ns - 10 * MS
    skew_ns = shown(now_ns) - now_ns
    clock.record_reading(reading(skew_ns, now_ns))
    now_ns += 33 * MS
    captured_ns = clock.captured_ns(message(now_ns + skew_ns - 30 * MS, now_ns + skew_ns - 20 * MS, 4), now_ns)
    assert captured_ns == pytest.approx(now_ns - 30 * MS, abs=MS)


def test_rule_3_copies_late_and_unused_messages_say_nothing_about_a_clock():
    clock = ObserverClock()
    for seq in (0, 1):
        use(clock, message(NOW + seq * MS - 10 * MS, NOW + seq * MS, seq), NOW + 5 * MS)
    for unused in (message(NOW, NOW, 1), message(NOW, NOW, 0), message(NOW, NOW + HOUR, 7), message(0, 0, 8)):
        clock.captured_ns(unused, NOW + 5 * MS)
    assert clock.captured_ns(message(NOW - 8 * MS, NOW + 2 * MS, 2), NOW + 5 * MS) == NOW - 8 * MS
    # A copy that is sent again much later is as old as it says.
    assert clock.captured_ns(message(NOW - 9 * MS, NOW + MS, 1), NOW + HOUR) == NOW - 9 * MS


def test_rule_3_a_clock_that_stood_still_is_doubted_after_it_runs_again():
    clock = clock_with(reading(0))
    for seq in (0, 1):
        use(clock, message(NOW - 10 * MS, NOW, seq), NOW + seq * SECOND_NS)
    assert use(clock, message(NOW - 9 * MS, NOW + MS, 2), NOW + 2 * SECOND_NS) == NOW + 2 * SECOND_NS - 10 * MS


@pytest.mark.parametrize(
    ("captured_ns", "sent_ns", "corrected_ns"),
    [(NOW + HOUR - 30 * MS, NOW + HOUR, NOW - 30 * MS), (NOW + HOUR, NOW - 10 * MS, NOW - 10 * MS)],
    ids=["rule 2: sent in the future", "rule 4: captured after it was sent"],
)
def test_rules_2_and_4_an_impossible_stamp_makes_nothing_fresh_for_ever(captured_ns, sent_ns, corrected_ns):
    assert ObserverClock().captured_ns(message(captured_ns, sent_ns), NOW) == corrected_ns


@given(
    skew_ns=st.integers(-2 * HOUR, 2 * HOUR),
    latency_ns=st.integers(0, 500 * MS),
    way_ns=st.integers(0, 50 * MS),
    back_ns=st.integers(0, 50 * MS),
)
def test_the_age_is_right_to_within_the_uncertainty_whatever_the_clock_shows(skew_ns, latency_ns, way_ns, back_ns):
    clock = clock_with(ClockReading(NOW, NOW + way_ns + skew_ns, NOW + way_ns + back_ns))
    sent_ns = NOW + SECOND_NS
    posterior = message(sent_ns - latency_ns + skew_ns, sent_ns + skew_ns)
    doubt_ns = max((way_ns + back_ns) // 2, IGNORED_SKEW_NS)
    error_ns = clock.captured_ns(posterior, sent_ns + way_ns) - (sent_ns - latency_ns)
    assert abs(error_ns) <= doubt_ns + abs(way_ns - back_ns) + 1
