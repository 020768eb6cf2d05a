"""Which frames an observer judges that is too slow for all of them."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from common import SECOND_NS
from observer.runtime.pipeline import HURRIED_S, Hurry
from observer.tracks import Frame

PERIOD_NS, JUDGED_S = SECOND_NS // 15, 0.2


def frames(skipped):
    """Frames of a camera of 15 Hz; skipped: how many are left out before each."""
    numbers = np.cumsum([n + 1 for n in skipped])
    return [Frame(int(number) * PERIOD_NS, np.empty(0), skipped=n) for number, n in zip(numbers, skipped, strict=True)]


@given(st.integers(1, 60))
def test_an_observer_that_keeps_up_judges_each_frame(count):
    hurry = Hurry(JUDGED_S)
    assert all(hurry.judges(frame) for frame in frames([0] * count))


@given(st.lists(st.integers(1, 8), min_size=2, max_size=40))
def test_one_that_does_not_judges_as_soon_as_the_last_judgement_is_old(skipped):
    hurry, judged_ns = Hurry(JUDGED_S), None
    for frame in frames(skipped):
        due = judged_ns is None or frame.captured_ns - judged_ns >= JUDGED_S * SECOND_NS
        assert hurry.judges(frame) == due
        judged_ns = frame.captured_ns if due else judged_ns


def test_it_is_in_a_hurry_for_a_while_after_the_last_frame_that_was_left_out():
    hurry, each = Hurry(JUDGED_S), frames([0, 2] + [0] * 30)
    judged = [hurry.judges(frame) for frame in each]
    over = next(n for n, frame in enumerate(each) if frame.captured_ns - each[1].captured_ns >= HURRIED_S * SECOND_NS)
    assert sum(judged[1:over]) <= (HURRIED_S / JUDGED_S) + 1 and all(judged[over:])


def test_a_clock_that_is_set_back_silences_no_observer():
    hurry = Hurry(JUDGED_S)
    assert hurry.judges(Frame(100 * SECOND_NS, np.empty(0), skipped=1))
    assert hurry.judges(Frame(SECOND_NS, np.empty(0), skipped=1))
