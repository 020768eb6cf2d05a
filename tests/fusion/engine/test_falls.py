"""The stages of the watch for falls, from the evidence of several observers."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common import SECOND_NS
from fusion.engine.falls import FallDetector, pooled

AFTER_S = 1.5
LYING = st.one_of(st.none(), st.floats(0, 1))


def stages(*moments, after_s=AFTER_S):
    """The stage after each (time in s, evidence of one or more observers)."""
    detector = FallDetector(after_s)
    return [detector.update(dict(enumerate(_list(p))), round(at * 1e9)).stage for at, p in moments]


def _list(p):
    return p if isinstance(p, list) else [p]


def every(begin, end, p, step=0.1):
    return [(begin + n * step, p) for n in range(round((end - begin) / step))]


def test_who_lies_for_long_enough_has_fallen_and_gets_up_again():
    result = stages(*every(0, 1, 0.0), *every(1, 4, 0.9), *every(4, 6, 0.1))
    assert result[9] == "up" and result[10] == "low" and result[24] == "low"
    assert result[25] == result[39] == result[45] == "fallen" and result[-1] == "up"


CASES = {
    "lies for a moment": ([(1.3, 0.9), (2.7, 0.1)], {"up", "low"}),
    "one of two sees that": ([(8, [1.0, 0.2])], {"up"}),
    "two of five see that": ([(8, [1.0, 1.0, 0.0, 0.0, 0.0])], {"up"}),
    "the only one that sees the person sees that": ([(8, [1.0, None])], {"up", "low", "fallen"}),
    "both see that": ([(8, [1.0, 0.9])], {"up", "low", "fallen"}),
    "is lost while they lie": ([(0.6, 0.9), (7.4, None)], {"up", "low", "fallen"}),
    "is lost after a glance": ([(0.1, 0.9), (7.9, None)], {"up", "low"}),
}


@pytest.mark.parametrize(("story", "seen"), CASES.values(), ids=CASES)
def test_after_a_second_in_which_the_person_is_up(story, seen):
    """story: for how many seconds which evidence; seen: the stages that follow one another."""
    moments, at_s = every(0, 1, [0.0] * 5), 1.0
    for seconds, p in story:
        moments += every(at_s, at_s := at_s + seconds, p)
    assert set(result := stages(*moments)) == seen and ("fallen" not in seen or result[-1] == "fallen")


def test_who_lies_from_the_start_has_not_fallen():
    assert set(stages(*every(0, 9, 0.9))) == {"unknown"}


def test_an_alarm_does_not_end_because_nobody_is_seen():
    result = stages(*every(0, 1, 0.0), *every(1, 4, 0.9), *every(4, 60, None), *every(60, 62, 0.0))
    assert result[-25] == "fallen" and result[-1] == "up"


def test_a_restored_alarm_goes_on_until_somebody_is_seen_up():
    detector = FallDetector(AFTER_S)
    detector.restore("fallen", 0, 60 * SECOND_NS)
    stages = [detector.update({"cam1": p}, round(at * SECOND_NS)).stage for at, p in every(60, 63, None)]
    stages += [detector.update({"cam1": p}, round(at * SECOND_NS)).stage for at, p in every(63, 65, 0.0)]
    assert stages[29] == "fallen" and stages[-1] == "up"


def test_falls_are_numbered():
    detector = FallDetector(AFTER_S)
    for at, p in [*every(0, 1, 0.0), *every(1, 4, 0.9), *every(4, 6, 0.0), *every(6, 9, 0.9)]:
        state = detector.update({"cam1": p}, round(at * SECOND_NS))
    assert state.number == 2 and state.stage == "fallen" and state.since_ns == 6 * SECOND_NS and state.n == state.k == 1


@given(st.dictionaries(st.sampled_from("abcdef"), LYING))
def test_the_pooled_evidence_is_what_enough_observers_reach(lying):
    p, seen = pooled(lying), [each for each in lying.values() if each is not None]
    if not seen:
        assert p is None
        return
    agree = sum(each >= p for each in seen)
    assert agree >= min(2, len(seen)) and 2 * agree >= len(seen) and p in seen


@given(st.lists(st.tuples(st.floats(0, 5), st.lists(LYING, max_size=4)), max_size=60))
def test_nobody_falls_from_any_other_stage_than_low(steps):
    detector, at_s, before = FallDetector(AFTER_S), 0.0, "unknown"
    for passed_s, lying in steps:
        at_s += passed_s
        state = detector.update(dict(enumerate(lying)), round(at_s * SECOND_NS))
        if state.stage == "fallen":
            assert before in ("low", "fallen") and at_s * SECOND_NS - state.since_ns >= AFTER_S * SECOND_NS - 1
        before = state.stage
