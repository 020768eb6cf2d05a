"""The judge: one test a rule on a scripted movement, then what holds for any beliefs at any times."""

from collections import Counter
from itertools import chain, pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.config_sections import FusionConfig
from common.vocabulary import ABSTAIN
from fusion.engine.verdict_detector import MovementPhase, PooledState, VerdictDetector

STEP_NS = 100_000_000
HOLD = 3
"""Steps of a tenth of a second; hold_s is three of them."""
DEMAND = FusionConfig(threshold=0.8, quorum=2, hold_s=0.3)
LOOSE = FusionConfig(threshold=0.8, quorum=2, hold_s=0.0)


def rest(n, label="bow", p=0.5, agreeing=0):
    return [(label, p, agreeing, 0.9)] * n


def moving(n, label="bow", p=0.5, agreeing=2):
    return [(label, p, agreeing, 0.1)] * n


def sure(n, label="bow", agreeing=2):
    return moving(n, label, 0.9, agreeing)


def still_sure(n, label="bow", agreeing=2):
    return rest(n, label, 0.9, agreeing)


def watched(*parts, demand=DEMAND, start=0):
    """What is said, as (label, began, decided, ended) in steps, and at which step."""
    judge, said = VerdictDetector(demand), {}
    for step, (label, p, agreeing, resting) in enumerate(chain(*parts), start):
        decision = judge.watch(PooledState(step * STEP_NS, label, p, agreeing, resting))
        if decision is not None:
            times = (decision.began_ns, decision.decided_ns, decision.ended_ns)
            said[step] = (decision.label, *(None if t is None else t // STEP_NS for t in times))
    return said


def test_a_movement_is_said_when_it_is_decided_and_when_it_has_ended():
    said = watched(rest(5), moving(2), sure(10), rest(10))
    assert said == {10: ("bow", 5, 10, None), 20: ("bow", 5, 10, 17)}


# Rule 1


def test_rule_1_rest_says_nothing_however_sure_they_are():
    assert watched(still_sure(30)) == {}
    assert watched([("bow", 0.9, 4, 0.5)] * 30) == {}


def test_rule_1_a_flicker_of_rest_does_not_say_the_last_movement_again():
    again = watched(sure(10), still_sure(10), sure(1), still_sure(10), sure(2), still_sure(10))
    assert again == {3: ("bow", 0, 3, None), 13: ("bow", 0, 3, 10)}


@pytest.mark.parametrize("length", [1, 2])
def test_rule_1_what_is_shorter_than_the_hold_is_no_movement(length):
    assert watched(rest(5), moving(length), rest(20)) == {}


# Rule 2


def test_rule_2_the_hold_is_without_a_break():
    assert watched(sure(3), moving(1), sure(3), moving(1), sure(4)) == {11: ("bow", 0, 11, None)}
    assert watched(sure(3), sure(3, "lunge"), sure(3), sure(4, "lunge")) == {12: ("lunge", 0, 12, None)}


def test_rule_2_the_quorum_is_met_all_the_time():
    assert watched(sure(20, agreeing=1)) == {}
    assert watched(sure(3), sure(1, agreeing=1), sure(4)) == {7: ("bow", 0, 7, None)}


def test_rule_2_threshold_and_hold_are_met_when_they_are_reached():
    assert watched(moving(4, p=0.8)) == {3: ("bow", 0, 3, None)}
    assert watched(moving(20, p=0.7999)) == {}


def test_rule_2_without_a_hold_it_is_decided_at_once():
    assert watched(rest(1), sure(3), rest(3), demand=LOOSE) == {1: ("bow", 1, 1, None), 4: ("bow", 1, 1, 4)}


# Rule 3


def test_rule_3_a_short_rest_is_part_of_the_movement():
    assert watched(sure(6), rest(2), sure(6), rest(9)) == {3: ("bow", 0, 3, None), 17: ("bow", 0, 3, 14)}


def test_rule_3_what_they_held_when_it_came_to_rest_is_said_at_the_end():
    said = watched(sure(5), sure(5, "lunge"), still_sure(5, "lunge"))
    assert said == {3: ("bow", 0, 3, None), 13: ("lunge", 0, 10, 10)}


def test_rule_3_minds_changed_in_between_or_not_for_long_are_not_said():
    assert watched(sure(5), sure(5, "lunge"), sure(5), still_sure(5))[18] == ("bow", 0, 3, 15)
    assert watched(sure(5), sure(2, "lunge"), still_sure(5, "lunge"))[10] == ("bow", 0, 3, 7)


def test_rule_3_a_judge_who_is_sure_and_wrong_does_not_win_when_the_others_forget():
    assert watched(sure(10), still_sure(9, "lunge"))[13] == ("bow", 0, 3, 10)


def test_rule_3_a_rest_that_broke_revises_nothing():
    said = watched(sure(5), sure(5, "lunge"), still_sure(1, "lunge"), sure(5), still_sure(5))
    assert said[19] == ("bow", 0, 3, 16)


def test_rule_3_what_was_something_else_when_it_came_to_rest_is_taken_back():
    for unlearned, label in ((0.7, "bow"), (0.9, ABSTAIN)):
        judge = VerdictDetector(DEMAND)
        beliefs = [PooledState(n * STEP_NS, "bow", 0.9, 2, 0.1) for n in range(6)]
        beliefs += [PooledState(n * STEP_NS, "bow", 0.05, 2, 0.9, unlearned) for n in range(6, 10)]
        said = [decision for belief in beliefs if (decision := judge.watch(belief))]
        assert [decision.label for decision in said] == ["bow", label]
        assert {decision.began_ns for decision in said} == {0} and said[1].ended_ns == 6 * STEP_NS


# Rule 4


def test_rule_4_what_ends_undecided_is_an_abstention():
    assert watched(rest(2), moving(9), rest(9)) == {14: (ABSTAIN, 2, 14, 11)}
    assert watched(sure(9, agreeing=1), rest(9)) == {12: (ABSTAIN, 0, 12, 9)}


def test_rule_4_a_quorum_met_in_time_is_waited_for():
    late = watched(sure(6, agreeing=1), still_sure(2, agreeing=1), still_sure(9))
    assert late == {11: ("bow", 0, 11, 6)}


def test_rule_2_who_comes_to_rest_is_decided_at_once():
    assert watched(moving(4), still_sure(9)) == {4: ("bow", 0, 4, None), 7: ("bow", 0, 4, 4)}


def test_rule_4_but_not_for_ever():
    flapping = [*rest(1), *[*still_sure(1), *still_sure(1, "lunge")] * 9]
    assert watched(moving(6), flapping) == {12: (ABSTAIN, 0, 12, 6)}
    assert watched(moving(6), rest(4), still_sure(9)) == {9: (ABSTAIN, 0, 9, 6)}


# Rule 5


def test_rule_5_a_clock_set_back_starts_afresh():
    judge = VerdictDetector(DEMAND)
    for step in (100, 101, 102, 103):
        judge.watch(PooledState(step * STEP_NS, "bow", 0.9, 2, 0.1))
    assert judge.phase is MovementPhase.DECIDED and judge.grounds_at == {103 * STEP_NS}
    said = [judge.watch(PooledState(step * STEP_NS, "bow", 0.9, 2, 0.1)) for step in range(4)]
    assert said[:3] == [None] * 3 and said[3].began_ns == 0


# What a home would be annoyed by


def test_two_movements_with_a_rest_between_are_two():
    said = watched(sure(6), still_sure(3), still_sure(3, "lunge"), sure(6, "lunge"), rest(4))
    assert [label for label, *_ in said.values()] == ["bow", "bow", "lunge", "lunge"]
    assert len({began for _, began, *_ in said.values()}) == 2


def test_the_grounds_are_asked_for_until_the_end_and_no_longer():
    judge, asked = VerdictDetector(DEMAND), []
    for step, (label, p, agreeing, resting) in enumerate(sure(6) + sure(6, "lunge") + still_sure(6, "lunge")):
        judge.watch(PooledState(step * STEP_NS, label, p, agreeing, resting))
        asked.append({t // STEP_NS for t in judge.grounds_at})
    assert asked == [set()] * 3 + [{3}] * 9 + [{3, 12}] * 3 + [set()] * 3


# Whatever they believe, whenever

BELIEFS = st.lists(
    st.tuples(
        st.sampled_from(["bow", "lunge"]),
        st.sampled_from([0.3, 0.9, 0.9]),
        st.sampled_from([0, 2, 2]),
        st.sampled_from([0.0, 0.2, 0.5, 1.0]),
        st.integers(0, 400),
        st.integers(1, 6),
    ),
    max_size=60,
)
DEMANDS = st.builds(
    FusionConfig,
    threshold=st.just(0.8),
    quorum=st.integers(1, 3),
    hold_s=st.sampled_from([0.0, 0.1, 0.3, 1.0]),
)


@given(BELIEFS, DEMANDS)
def test_at_most_one_decision_a_movement_and_its_times_are_in_order(beliefs, demand):
    judge, at_ns, history, said = VerdictDetector(demand), 0, [], []
    hold_ns = demand.hold_s * 1e9
    for label, p, agreeing, resting, wait_ms, times in beliefs:
        for _ in range(times):
            at_ns += wait_ms * 1_000_000
            history.append((at_ns, label, p, agreeing, resting))
            decision = judge.watch(PooledState(at_ns, label, p, agreeing, resting))
            if decision is not None:
                said.append((at_ns, decision, tuple(history)))
    times_said = Counter(d.began_ns for _, d, _ in said)
    assert all(n <= 2 for n in times_said.values())
    for said_ns, d, until_then in said:
        assert d.began_ns <= d.decided_ns <= said_ns and d.label in ("bow", "lunge", ABSTAIN)
        if d.ended_ns is None:
            assert d.decided_ns == said_ns and d.label != ABSTAIN
        else:
            assert d.began_ns <= d.ended_ns <= said_ns and d.ended_ns - d.began_ns >= hold_ns
            assert said_ns - d.ended_ns >= hold_ns
            assert all(r >= 0.5 for t, *_, r in until_then if d.ended_ns < t)
        if d.label != ABSTAIN:
            at_rest = any(t == d.decided_ns and r >= 0.5 for t, *_, r in until_then)
            # Who comes to rest is decided by what is believed then; it need not have been believed for long.
            since_ns = d.decided_ns - (0 if at_rest else hold_ns)
            held = [(lab, p, a) for t, lab, p, a, _ in until_then if since_ns < t < d.decided_ns]
            assert all(lab == d.label and p >= demand.threshold and a >= demand.quorum for lab, p, a in held)
    open_ = [d.began_ns for _, d, _ in said if d.ended_ns is None]
    closed = [d.began_ns for _, d, _ in said if d.ended_ns is not None]
    assert len(set(closed)) == len(closed) and set(open_[:-1]) <= set(closed)
    spans = sorted((d.began_ns, d.ended_ns) for _, d, _ in said if d.ended_ns is not None)
    assert all(one[1] <= other[0] for one, other in pairwise(spans))


@given(BELIEFS)
def test_times_that_jump_to_and_fro_raise_nothing(beliefs):
    judge, at_ns = VerdictDetector(DEMAND), 10**12
    for n, (label, p, agreeing, resting, wait_ms, times) in enumerate(beliefs):
        for _ in range(times):
            at_ns += wait_ms * 1_000_000 * (-1 if n % 7 == 6 else 1)
            decision = judge.watch(PooledState(at_ns, label, p, agreeing, resting))
            assert decision is None or decision.began_ns <= (decision.ended_ns or at_ns)


@given(BELIEFS, st.integers(0, 10**18))
def test_only_differences_of_time_count(beliefs, shift_ns):
    def told(start_ns):
        judge, at_ns, said = VerdictDetector(DEMAND), start_ns, []
        for label, p, agreeing, resting, wait_ms, times in beliefs:
            for _ in range(times):
                at_ns += wait_ms * 1_000_000
                d = judge.watch(PooledState(at_ns, label, p, agreeing, resting))
                if d:
                    said.append(
                        (d.label, d.began_ns - start_ns, d.decided_ns - start_ns, d.ended_ns and d.ended_ns - start_ns)
                    )
        return said

    assert told(0) == told(shift_ns)
