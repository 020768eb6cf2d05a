"""An observer's clock beside those of several fusion services: the owner's counts."""

import pytest
from message_stage import status

from common import SECOND_NS
from common.clock_skew import ClockReading
from common.message_types import STANDING_BY
from observer.runtime.service import CLOCKS_LIMIT, SILENT_NS, FusionClock

NOW_NS = 10**18


class Answers:
    """Stands in for the querier."""

    def __init__(self):
        self.pending = []

    def ask_if_due(self):
        return True

    def readings(self):
        pending, self.pending = self.pending, []
        return pending


@pytest.fixture
def clock():
    answers = Answers()
    fusion_clock = FusionClock(answers)

    def skew_s(at_s, *services):
        """Our skew after these answers: (service, how far it is behind our clock in seconds, its reason)."""
        at_ns = NOW_NS + round(at_s * SECOND_NS)
        for name, behind_s, reason in services:
            reading = ClockReading(at_ns, at_ns - round(behind_s * SECOND_NS), at_ns)
            answers.pending.append((status(id=name, reason=reason), reading))
        return fusion_clock.skew_s()

    return skew_s


def test_the_owners_clock_counts_and_no_other_disturbs_it(clock):
    assert clock(0) is None and clock(0, ("b", 9, f"{STANDING_BY} for a")) is None
    for second in range(1, 20):
        assert clock(second, ("b", 9, f"{STANDING_BY} for a"), ("a", 2, "")) == 2
        assert clock(second, ("b", 9, f"{STANDING_BY} for a")) == 2


def test_the_next_owner_counts_at_once_after_a_handover_and_soon_after_a_death(clock):
    assert clock(0, ("a", 2, ""), ("b", 9, STANDING_BY)) == 2
    assert clock(1, ("a", 2, f"{STANDING_BY} for b"), ("b", 9, "")) == 9
    assert clock(2, ("c", 5, "")) == 9
    assert clock(2 + SILENT_NS / SECOND_NS, ("c", 5, "")) == 5


def test_of_many_services_the_owner_is_kept(clock):
    clock(0, ("a", 2, ""))
    for n in range(3 * CLOCKS_LIMIT):
        assert clock(n / 100, (f"s{n}", 9, STANDING_BY)) == 2
    assert clock(1) == 2
