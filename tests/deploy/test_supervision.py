"""When a process is started again, and when not."""

import pytest

from deploy.launcher import RunDecision, RunHistory


@pytest.mark.parametrize(
    ("lasting", "status", "decision"),
    [
        (False, 0, RunDecision.FINISHED),
        (True, 0, RunDecision.RESTART),
        (False, 1, RunDecision.RESTART),
        (True, 1, RunDecision.RESTART),
        (False, -9, RunDecision.RESTART),
        (False, 2, RunDecision.GIVEN_UP),
        (True, 2, RunDecision.GIVEN_UP),
    ],
)
def test_what_becomes_of_an_end(lasting, status, decision):
    assert RunHistory(lasting).decide(status, 1.0) is decision


def test_pauses_double_up_to_the_longest_and_a_long_run_forgives():
    history, pauses = RunHistory(False), []
    for _ in range(9):
        history.decide(1, 0.1)
        pauses.append(history.pause_s)
    assert pauses == [0.5, 1, 2, 4, 8, 16, 30, 30, 30]
    history.decide(1, 60.0)
    assert history.pause_s == 0.5


def test_too_many_failures_in_a_row_are_given_up():
    history = RunHistory(False, most=3)
    assert [history.decide(1, 0.1) for _ in range(3)] == [*[RunDecision.RESTART] * 2, RunDecision.GIVEN_UP]
