"""When a process is started again, and when not."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deploy.supervision import Career, Outcome, Patience


@pytest.mark.parametrize(
    ("lasting", "status", "outcome"),
    [
        (False, 0, Outcome.FINISHED),
        (True, 0, Outcome.RESTART),
        (False, 1, Outcome.RESTART),
        (True, 1, Outcome.RESTART),
        (False, -9, Outcome.RESTART),
        (False, 2, Outcome.GIVEN_UP),
        (True, 2, Outcome.GIVEN_UP),
    ],
)
def test_what_becomes_of_an_end(lasting, status, outcome):
    assert Career(lasting).ended(status, 1.0) is outcome


def test_pauses_double_up_to_the_longest():
    career, pauses = Career(False), []
    for _ in range(9):
        career.ended(1, 0.1)
        pauses.append(career.pause_s)
    assert pauses == [0.5, 1, 2, 4, 8, 16, 30, 30, 30]


def test_a_long_run_forgives():
    career = Career(False)
    for _ in range(5):
        career.ended(1, 0.1)
    career.ended(1, 60.0)
    assert career.pause_s == 0.5


def test_too_many_failures_in_a_row_are_given_up():
    career = Career(False, Patience(failures=3))
    assert [career.ended(1, 0.1) for _ in range(3)] == [Outcome.RESTART, Outcome.RESTART, Outcome.GIVEN_UP]


@given(st.lists(st.tuples(st.integers(1, 255).filter(lambda s: s != 2), st.floats(0, 1e6)), min_size=1, max_size=200))
def test_a_pause_is_never_shorter_than_the_first_nor_longer_than_the_longest(runs):
    career = Career(True)
    for status, ran_s in runs:
        assert career.ended(status, ran_s) is Outcome.RESTART
        assert 0.5 <= career.pause_s <= 30
