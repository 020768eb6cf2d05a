"""SceneState: messages of a scene folded into what all views show."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hub.dashboard.history import SceneHistory
from hub.dashboard.page_data import state_data
from hub.scene_state import VERDICTS_LIMIT, SceneState, is_waiting


def folded(state, *messages, at):
    for message in messages:
        state = state.fold(message, at)
    return state


def test_an_observer_has_its_label_posterior_entropy_weight_age_and_state(make):
    votes = {"cam1": make.vote("ok", (0.1, 0.1, 0.5, 0.3), 0.25, age_s=0.1), "cam2": make.vote(weight=0.75)}
    state = folded(SceneState("room"), make.vocabulary(), make.judgement(votes=votes), at=make.NOON)
    cam1, cam2 = state.at(make.NOON + make.SECOND).observers
    assert [(ranked.label, ranked.p) for ranked in cam1.ranked[:2]] == [("ok", 0.5), ("nthrow", 0.3)]
    assert (cam1.label, cam1.weight, cam1.state, cam1.agrees) == ("ok", 0.25, "counted", False)
    assert math.isclose(cam1.age_s, 1.1) and math.isclose(cam1.entropy, 1.6855, abs_tol=1e-3)
    assert cam2.agrees and state.fused[0].label == "nthrow"


def test_observers_of_the_scene_file_come_first_and_show_before_they_are_heard(make):
    state = folded(SceneState("room", ("cam9", "cam2")), make.judgement(), at=make.NOON)
    observers = [(observer.name, observer.state) for observer in state.observers]
    assert observers == [("cam9", "silent"), ("cam2", "counted"), ("cam1", "counted")]


STATES = st.sampled_from(["counted", "stale", "late", "silent", "foreign", "invalid"])


@given(st.lists(st.tuples(STATES, st.sampled_from(["ok", "nthrow", None])), max_size=6))
def test_the_observers_that_agree_are_the_k_of_the_agreement(make, votes):
    votes = {f"cam{i}": make.vote(label, state=state) for i, (state, label) in enumerate(votes)}
    judgement = make.judgement(votes=votes)
    observers = SceneState("room").fold(judgement, make.NOON).observers
    assert sum(observer.agrees for observer in observers) == judgement.agreement.k
    assert sum(observer.is_heard for observer in observers) == judgement.agreement.n


@pytest.mark.parametrize("label", ["", "byebye"])
def test_without_a_heard_vote_the_scene_waits_for_observers(make, label):
    state = SceneState("room").fold(make.waiting(label=label), make.NOON)
    assert state.waiting and state.fused == () and not any(observer.agrees for observer in state.observers)
    assert not is_waiting(make.judgement(votes={"cam1": make.vote(state="stale")}))


def test_an_update_of_a_verdict_replaces_it(make):
    first, other, ended = make.verdict(1), make.verdict(2), make.verdict(1, ended_ns=make.NOON, at_ns=make.NOON + 1)
    state = folded(SceneState("room"), first, other, ended, at=make.NOON)
    assert [verdict.id for verdict in state.verdicts] == ["v2", "v1"]
    assert state.verdicts[1].ended_ns == make.NOON
    assert folded(state, first, at=make.NOON).verdicts == state.verdicts, "an older message does not reopen it"


def test_the_last_word_on_a_revised_movement_keeps_what_it_replaced(make):
    first, at_ns = make.verdict(1, label="ok"), make.NOON
    revised = make.verdict(1, stage="revised", revises="ok", at_ns=at_ns)
    ended = make.verdict(1, ended_ns=at_ns, revises="ok", at_ns=at_ns)
    for words in ((first, revised, ended), (first, revised, ended, revised)):
        (last,) = folded(SceneState("room"), *words, at=at_ns).verdicts
        assert (last.stage, last.label, last.revises) == ("ended", "nthrow", "ok"), words


def test_messages_of_a_fusion_machine_whose_clock_was_set_back_are_shown(make):
    hour = 3600 * make.SECOND
    before = (make.verdict(1, began_ns=make.NOON + hour), make.judgement(9, make.NOON + hour))
    after = (make.verdict(2), make.judgement(10, make.NOON))
    state = folded(SceneState("room"), *before, *after, at=make.NOON)
    assert state.verdict.id == "v2" and state.judgement.seq == 10


def test_copies_change_nothing(make):
    state = folded(SceneState("room"), make.judgement(5), make.verdict(1), at=make.NOON)
    assert state.fold(make.judgement(5), make.NOON) is state
    assert state.fold(make.judgement(4, make.NOON - make.SECOND // 10), make.NOON) is state
    assert state.fold(make.verdict(1), make.NOON) is state


def test_labels_of_another_vocabulary_are_not_used(make):
    foreign = make.vocabulary().model_copy(update={"hash": "0" * 16})
    state = folded(SceneState("room"), foreign, make.judgement(), at=make.NOON)
    assert state.labels == () and state.missing_vocabulary.hash == make.vocabulary().hash
    assert [ranked.label for ranked in state.fused] == ["nthrow", "movement 3", "movement 1", "movement 2"]


def test_silence_is_measured_by_this_machines_clock(make):
    state = SceneState("room")
    assert state.silence_s == math.inf
    state = state.fold(make.judgement(at_ns=make.NOON + 3600 * make.SECOND), make.NOON)
    assert state.at(make.NOON + 3 * make.SECOND).silence_s == 3


@given(st.lists(st.tuples(st.integers(0, 14), st.booleans(), st.integers(0, 5)), max_size=60))
def test_verdicts_are_limited_and_each_appears_once(make, steps):
    state = SceneState("room")
    for number, has_ended, later in steps:
        at_ns = make.NOON + later
        state = state.fold(make.verdict(number, make.NOON if has_ended else None, at_ns), at_ns)
    ids = [verdict.id for verdict in state.verdicts]
    assert len(ids) == len(set(ids)) <= VERDICTS_LIMIT and bool(ids) == bool(steps)


PROBABILITIES = st.lists(st.floats(0, 1), max_size=6)


@given(PROBABILITIES, PROBABILITIES, st.floats(0, 1) | st.none())
def test_answers_are_ranked_by_whole_percents(make, p, fused, unlearned):
    votes = {"cam1": make.vote(unlearned=unlearned).model_copy(update={"p": p})}
    judgement = make.judgement(votes=votes, p=fused, unlearned=unlearned)
    state = folded(SceneState("room"), make.vocabulary(), judgement, at=0)
    for ranked in (state.fused, state.observers[0].ranked):
        shares = [round(each.p, 2) for each in ranked]
        assert all(0 <= share <= 1 for share in shares) and shares == sorted(shares, reverse=True)


def test_invented_processes_do_not_grow_the_state_and_those_of_the_scene_file_are_always_there(make):
    state = SceneState("room", ("cam1",), services=("fusion",))
    for n in range(15_000):
        state = folded(state, make.status(f"invented{n}"), at=make.NOON)
        if n % 100 == 0:
            state = state.fold(make.status(f"invented{n}"), make.NOON, "fusion")
    state = folded(state, make.status("cam1"), at=make.NOON).fold(make.status("fusion"), make.NOON, "fusion")
    assert (len(state.observer_status), len(state.fusion_status)) == (65, 65)
    assert "cam1" in state.observer_status and "fusion" in state.fusion_status
    assert len(json.dumps(state_data(SceneHistory(state)))) < 64_000
