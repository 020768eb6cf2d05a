"""Clock skew against clocks of known skew, over a network with random delays."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from message_stage import status

from common import SECOND_NS
from common.clock_skew import DRIFT, ClockQuerier, ClockReading, ClockSkew
from common.wire import encode

MS = 1_000_000


def ask(at_ns, skew_ns, there_ns, back_ns):
    return ClockReading(at_ns, at_ns + there_ns + skew_ns, at_ns + there_ns + back_ns)


@given(
    st.integers(-(10**13), 10**13),
    st.lists(st.tuples(st.integers(0, 10**9), st.integers(0, 10**9)), min_size=1, max_size=20),
)
def test_the_true_skew_is_within_the_doubt_of_the_fastest_answer(skew_ns, delays):
    skew = ClockSkew()
    assert skew.skew_s is None
    for second, (there_ns, back_ns) in enumerate(delays):
        skew.note(ask(second * SECOND_NS, skew_ns, there_ns, back_ns))
    assert skew.best.doubt_ns == min((there + back) // 2 for there, back in delays[-8:])
    # Seconds as a float resolve nanoseconds only up to some days.
    rounding_ns = 1 + abs(skew_ns) * 2**-50
    assert abs(skew.skew_s * SECOND_NS - skew_ns) <= skew.best.doubt_ns + rounding_ns


@pytest.mark.parametrize("jump_s", [3600, -3600, 0.5])
def test_a_clock_that_was_set_is_believed_as_it_is_now(jump_s):
    skew = ClockSkew()
    for second in range(5):
        skew.note(ask(second * SECOND_NS, 0, MS, MS))
    skew.note(ask(6 * SECOND_NS, round(jump_s * SECOND_NS), 20 * MS, 20 * MS))
    assert skew.skew_s == pytest.approx(jump_s, abs=0.02)


def test_a_clock_that_stands_still_falls_behind():
    skew = ClockSkew()
    for second in range(10):
        skew.note(ClockReading(second * SECOND_NS, 0, second * SECOND_NS + MS))
        assert skew.skew_s == pytest.approx(-second, abs=0.001)


def test_a_clock_that_drifts_like_quartz_is_not_taken_for_one_that_was_set():
    skew = ClockSkew()
    for second in range(8):
        skew.note(ask(second * SECOND_NS, round(second * DRIFT / 2 * SECOND_NS), MS if second else 10_000, MS))
    assert skew.best.asked_ns == 0  # the fastest answer still counts


def test_the_process_is_the_one_in_the_key_and_a_field_that_claims_another_is_rejected():
    class Link:
        def request(self, key, answered, timeout_s):
            for process in ("cam1", "cam2"):
                answered(f"laban/dojo/observer/{process}/status", encode(status(at_ns=7 * SECOND_NS)))
            answered("laban/dojo/observer/cam3/status", b"nonsense")

    querier = ClockQuerier(Link(), "laban/dojo/observer/*/status", lambda: 5 * SECOND_NS)
    assert querier.ask_if_due() and not querier.ask_if_due()
    ((answer, reading),) = querier.readings()
    assert answer.id == "cam1" and reading.skew_ns == 2 * SECOND_NS and querier.readings() == []
