"""A phone's clock mapped to ours, over lines that delay each way differently."""

from hypothesis import given
from hypothesis import strategies as st

from common import MS_NS
from hub.phone.phone_session import LATE_S, QUESTIONS_LIMIT, PhoneClock

START_NS = 1_795_657_600_000_000_000


class Stage:
    """Our time, a phone whose clock is `ahead_ms` ahead, and a line between them."""

    def __init__(self, ahead_ms):
        self.ns, self.ahead_ms = START_NS, ahead_ms
        self.clock = PhoneClock(lambda: self.ns)

    def pass_ms(self, ms):
        self.ns += round(ms * MS_NS)

    @property
    def phone_ms(self):
        return self.ns / MS_NS + self.ahead_ms

    def ask(self, there_ms, back_ms):
        number = self.clock.ask()
        self.pass_ms(there_ms)
        shown = self.phone_ms
        self.pass_ms(back_ms)
        self.clock.answer(number, shown)

    def track(self, delay_ms):
        """Captured now, arrives after the delay; returns the error of its time in ms, None if it is dropped."""
        shown, true_ns = self.phone_ms, self.ns
        self.pass_ms(delay_ms)
        captured_ns = self.clock.captured_ns(shown)
        return None if captured_ns is None else (captured_ns - true_ns) / MS_NS


DELAY = st.floats(0.5, 400)


@given(st.floats(-1e9, 1e9), st.lists(st.tuples(DELAY, DELAY), min_size=1, max_size=12), st.floats(0, 900))
def test_the_error_is_at_most_half_of_the_shortest_way(ahead_ms, ways, delay_ms):
    stage = Stage(ahead_ms)
    for way in ways:
        stage.ask(*way)
        stage.pass_ms(1000)
    error = stage.track(delay_ms)
    bound = min(there + back for there, back in ways[-8:]) / 2 + 3  # drift of 12 s at 200 ppm
    if error is not None:
        assert -bound <= error <= min(bound, delay_ms + 0.001)
    else:
        assert delay_ms + bound > 1000 * LATE_S


@given(st.floats(-1e9, 1e9), st.floats(0.5, 30), st.lists(st.floats(0, 400), min_size=1, max_size=8))
def test_a_busy_page_dates_its_tracks_no_earlier(ahead_ms, line_ms, busy_ms):
    stage = Stage(ahead_ms)
    for each in busy_ms:
        stage.clock.note_line(line_ms / 1000)
        stage.ask(line_ms / 2 + each, line_ms / 2)
        stage.pass_ms(1000)
    assert abs(stage.track(500)) < 1e-3


def test_nothing_counts_before_the_clock_is_known():
    stage = Stage(5000)
    assert stage.track(10) is None and stage.clock.dropped == 1


def test_late_repeated_and_older_tracks_are_dropped():
    stage = Stage(-3_600_000)
    stage.ask(5, 5)
    assert stage.track(1500) is None
    now_ms = stage.phone_ms
    assert stage.clock.captured_ns(now_ms) is not None
    assert stage.clock.captured_ns(now_ms) is None and stage.clock.captured_ns(now_ms - 40) is None
    assert stage.clock.dropped == 3


def test_no_picture_is_from_the_future():
    stage = Stage(0)
    stage.ask(5, 5)
    assert stage.clock.captured_ns(stage.phone_ms + 1e6) == stage.ns


def test_a_clock_that_is_set_is_believed_as_it_is_now():
    stage = Stage(0)
    for _ in range(5):
        stage.ask(4, 4)
        stage.pass_ms(1000)
    stage.ahead_ms = 7_200_000
    stage.ask(4, 4)
    assert abs(stage.track(20)) < 5


def test_answers_that_were_not_asked_for_change_nothing():
    stage = Stage(0)
    stage.ask(4, 4)
    stage.clock.answer(1, 0.0)
    stage.clock.answer(99, 1e12)
    assert abs(stage.track(10)) < 5


def test_questions_that_nobody_answers_use_no_memory():
    stage = Stage(0)
    for _ in range(1000):
        stage.clock.ask()
    assert len(stage.clock._asked_ns) == QUESTIONS_LIMIT
