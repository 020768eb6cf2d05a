"""What is heard of a scene, folded into what is shown."""

import math

from hypothesis import given
from hypothesis import strategies as st

from hub.scene_state import VERDICTS_LIMIT, SceneState


def folded(state, *messages, at):
    for message in messages:
        state = state.fold(message, at)
    return state


def test_judges_carry_label_belief_entropy_weight_age_and_state(said):
    votes = {"cam1": said.vote("ok", (0.1, 0.1, 0.5, 0.3), 0.25, age_s=0.1), "cam2": said.vote(weight=0.75)}
    state = folded(SceneState("room"), said.vocabulary(), said.judgement(votes=votes), at=said.NOON)
    cam1, cam2 = state.at(said.NOON + said.SECOND).observers
    assert [(belief.label, belief.p) for belief in cam1.ranked[:2]] == [("ok", 0.5), ("nthrow", 0.3)]
    assert (cam1.label, cam1.weight, cam1.state, cam1.agrees) == ("ok", 0.25, "counted", False)
    assert math.isclose(cam1.age_s, 1.1) and math.isclose(cam1.entropy, 1.6855, abs_tol=1e-3)
    assert cam2.agrees and state.fused[0].label == "nthrow"


def test_a_named_observer_has_a_corner_before_it_spoke(said):
    state = folded(SceneState("room", ("cam9", "cam2")), said.judgement(), at=said.NOON)
    assert [(judge.name, judge.state) for judge in state.observers] == [
        ("cam9", "silent"), ("cam2", "counted"), ("cam1", "counted"),
    ]  # fmt: skip


def test_the_same_verdict_said_again_replaces_what_was_said(said):
    first, other, ended = said.verdict(1), said.verdict(2), said.verdict(1, ended_ns=said.NOON, at_ns=said.NOON + 1)
    state = folded(SceneState("room"), first, other, ended, at=said.NOON)
    assert [verdict.id for verdict in state.verdicts] == ["v2", "v1"]
    assert state.verdicts[1].ended_ns == said.NOON
    assert folded(state, first, at=said.NOON).verdicts == state.verdicts, "an older word must not reopen a movement"


def test_a_fusion_whose_clock_was_set_back_is_still_shown(said):
    hour = 3600 * said.SECOND
    before = (said.verdict(1, began_ns=said.NOON + hour), said.judgement(9, said.NOON + hour))
    after = (said.verdict(2), said.judgement(10, said.NOON))
    state = folded(SceneState("room"), *before, *after, at=said.NOON)
    assert state.verdict.id == "v2" and state.judgement.seq == 10


def test_copies_change_nothing(said):
    state = folded(SceneState("room"), said.judgement(5), said.verdict(1), at=said.NOON)
    assert state.fold(said.judgement(5), said.NOON) is state
    assert state.fold(said.judgement(4, said.NOON - said.SECOND // 10), said.NOON) is state
    assert state.fold(said.verdict(1), said.NOON) is state


def test_labels_of_another_vocabulary_are_not_used(said):
    foreign = said.vocabulary().model_copy(update={"hash": "0" * 16})
    state = folded(SceneState("room"), foreign, said.judgement(), at=said.NOON)
    assert state.labels == () and state.missing_vocabulary.hash == said.vocabulary().hash
    assert [belief.label for belief in state.fused] == ["nthrow", "movement 3", "movement 1", "movement 2"]


def test_statuses_of_an_observer_and_a_fusion_with_one_name_are_kept_apart(said):
    state = SceneState("room").fold(said.status("a"), 0, "observer").fold(said.status("a", "failed"), 0, "fusion")
    assert state.observers[0].status.state == "running" and state.fusion_status["a"].state == "failed"


def test_silence_is_counted_from_hearing_not_from_foreign_clocks(said):
    state = SceneState("room")
    assert state.silence_s == math.inf
    state = state.fold(said.judgement(at_ns=said.NOON + 3600 * said.SECOND), said.NOON)
    assert state.at(said.NOON + 3 * said.SECOND).silence_s == 3


@given(st.lists(st.tuples(st.integers(0, 14), st.booleans(), st.integers(0, 5)), max_size=60))
def test_verdicts_are_few_and_each_stands_once(said, spoken):
    state = SceneState("room")
    for number, has_ended, later in spoken:
        at_ns = said.NOON + later
        state = state.fold(said.verdict(number, said.NOON if has_ended else None, at_ns), at_ns)
    ids = [verdict.id for verdict in state.verdicts]
    assert len(ids) == len(set(ids)) == min(VERDICTS_LIMIT, len(ids))
    assert not spoken or ids


@given(st.lists(st.floats(0, 1), max_size=6), st.lists(st.floats(0, 1), max_size=6), st.floats(0, 1) | st.none())
def test_answers_are_ranked_by_whole_percents(said, p, judged, unlearned):
    votes = {"cam1": said.vote().model_copy(update={"p": p, "unlearned": unlearned})}
    judgement = said.judgement(votes=votes).model_copy(update={"p": judged, "unlearned": unlearned})
    state = folded(SceneState("room"), said.vocabulary(), judgement, at=0)
    for ranked in (state.fused, state.observers[0].ranked):
        shares = [round(each.p, 2) for each in ranked]
        assert all(0 <= share <= 1 for share in shares) and shares == sorted(shares, reverse=True)
