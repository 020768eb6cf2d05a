"""Early words: each is confirmed, corrected or withdrawn once under its id, whatever is said in whatever order."""

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.messages import OngoingMovement
from common.vocabulary import ABSTAIN
from hub.anticipation import CLOSED_LIMIT, ENDED_S, NEVER, SILENT_S, Anticipation
from hub.wording import facing_words, leanings

SURE, UNSURE = (0.02, 0.03, 0.05, 0.9), (0.2, 0.2, 0.2, 0.4)


def going_on(said, number=1, p=SURE, label="nthrow", decided=None, **more):
    movement = OngoingMovement(id=f"v{number}", began_ns=said.NOON, label=decided, decided_ns=decided and said.NOON)
    return said.judgement(label=label, p=p).model_copy(update={"movement": movement, **more})


def listening(said):
    """A hub that has heard that nothing is believed yet."""
    hub = Anticipation(0.8)
    assert hub.update(said.judgement(p=UNSURE), 0.0) == []
    return hub


def stages(words):
    return [(word.stage, word.id, word.label, word.early) for word in words]


@pytest.mark.parametrize(("label", "stage"), [("nthrow", "confirmed"), ("ok", "corrected"), (ABSTAIN, "withdrawn")])
def test_an_early_word_is_judged_by_the_last_verdict_alone(said, label, stage):
    hub = listening(said)
    assert hub.update(going_on(said, p=UNSURE), 0.0) == []
    (word,) = hub.update(going_on(said), 0.1)
    assert (word.stage, word.label, word.p) == ("early", "nthrow", pytest.approx(0.9)) and hub.open == (word,)
    assert hub.update(going_on(said), 0.2) == [] == hub.update(said.verdict(1, label="maestro"), 0.3)
    end = said.verdict(1, ended_ns=said.NOON, label=label)
    assert stages(hub.update(end, 0.4)) == [(stage, "v1", label, "nthrow")]
    for late in (end, going_on(said), going_on(said, p=UNSURE), going_on(said)):
        assert hub.update(late, 0.5) == [], "what has ended stays ended"
    assert hub.open == ()


def test_what_is_still_believed_of_the_movement_before_is_not_early(said):
    hub = Anticipation(0.8)
    hub.update(said.judgement(p=SURE), 0.0)
    assert hub.update(going_on(said), 0.1) == [] == hub.update(going_on(said), 0.2), "memory of what was done before"
    assert hub.update(going_on(said, p=UNSURE), 0.3) == []
    assert len(hub.update(going_on(said), 0.4)) == 1, "doubted, and believed again: it is done again"
    assert len(hub.update(going_on(said, 2, (0.02, 0.03, 0.9, 0.05), "ok"), 0.5)) == 1, "another one is no memory"
    joined = Anticipation(0.8)
    assert joined.update(going_on(said), 0.0) == [], "who comes in the midst cannot tell"
    assert len(joined.update(going_on(said, 1, (0.02, 0.03, 0.9, 0.05), "ok"), 0.1)) == 1


def test_something_else_is_no_certainty(said):
    hub = listening(said)
    assert hub.update(going_on(said, unlearned=0.2), 0.0) == []
    assert len(hub.update(going_on(said, unlearned=0.1), 0.1)) == 1


def test_what_the_referee_has_decided_is_not_early_and_at_one_nothing_is(said):
    assert listening(said).update(going_on(said, decided="nthrow"), 0.0) == []
    hub = listening(said)
    assert hub.update(said.verdict(1), 0.0) == [] == hub.update(going_on(said), 0.1)
    never = Anticipation(NEVER)
    assert (
        never.update(said.judgement(p=UNSURE), 0.0) == [] == never.update(going_on(said, p=(0.0, 0.0, 0.0, 1.0)), 0.1)
    )


def test_a_flicker_without_verdict_and_a_referee_that_forgot_are_withdrawn(said):
    for after in (said.judgement(), going_on(said, 2, UNSURE)):
        hub = listening(said)
        hub.update(going_on(said), 0.0)
        assert hub.update(after, 0.1) == [] == hub.expire(0.1 + ENDED_S), "its verdict may be on the way"
        assert stages(hub.expire(0.2 + ENDED_S)) == [("withdrawn", "v1", ABSTAIN, "nthrow")]
        assert hub.update(said.verdict(1, ended_ns=said.NOON), 1.0) == [], "too late: it was withdrawn"


def test_another_fusion_service_may_go_on_with_it(said):
    hub = listening(said)
    hub.update(going_on(said), 0.0)
    assert hub.expire(SILENT_S) == []
    assert hub.update(going_on(said, fusion="fuse2"), SILENT_S) == [] == hub.expire(2 * SILENT_S)
    assert stages(hub.expire(2 * SILENT_S + 0.1)) == [("withdrawn", "v1", ABSTAIN, "nthrow")]


NUMBERS = st.integers(0, 2)
LABELS = st.sampled_from(("nthrow", "ok", ABSTAIN))
STEPS = st.one_of(
    st.tuples(st.just("judgement"), NUMBERS, st.sampled_from((SURE, UNSURE)), st.sampled_from((None, "ok"))),
    st.tuples(st.just("rest")),
    st.tuples(st.just("verdict"), NUMBERS, LABELS, st.booleans()),
    st.tuples(st.just("pause"), st.floats(0, 2 * SILENT_S)),
)


@given(st.lists(STEPS, max_size=60), st.floats(0.0, 0.95))
def test_every_early_word_is_ended_exactly_once(said, steps, certainty):
    hub, now_s, words = Anticipation(certainty), 0.0, []
    for kind, *more in steps:
        now_s += 0.1
        match kind:
            case "judgement":
                words += hub.update(going_on(said, more[0], more[1], decided=more[2]), now_s)
            case "rest":
                words += hub.update(said.judgement(), now_s)
            case "verdict":
                ended_ns = said.NOON if more[2] else None
                words += hub.update(said.verdict(more[0], ended_ns=ended_ns, label=more[1]), now_s)
            case "pause":
                now_s += more[0]
                words += hub.expire(now_s)
    words += hub.expire(now_s + SILENT_S + 0.1)
    began, ended = [w.id for w in words if w.stage == "early"], [w.id for w in words if w.stage != "early"]
    assert len(set(began)) == len(began) and Counter(began) == Counter(ended)
    for word in words:
        assert words.index(word) >= began.index(word.id)
        assert (word.label == word.early) == (word.stage in ("early", "confirmed"))
        assert (word.label == ABSTAIN) == (word.stage == "withdrawn")
    assert hub.open == ()


def test_its_memory_does_not_grow(said):
    hub = listening(said)
    for number in range(3 * CLOSED_LIMIT):
        hub.update(going_on(said, number, UNSURE), float(number))
        assert len(hub.update(going_on(said, number), float(number))) == 1
        hub.update(said.verdict(number, ended_ns=said.NOON), number + 0.1)
    assert len(hub._closed) == CLOSED_LIMIT and hub.open == ()


def test_facets_lean_to_a_pole_and_nonsense_is_left_out():
    said = {"shape_vertical": [0.1, 0.2, 0.7], "effort_time": [0.8, 0.2], "effort_flow": [0.5], "mood": [1.0]}
    time, vertical = leanings(said)
    assert (time.facet, time.value, time.p, time.poles) == ("effort_time", "sustained", 0.8, ("sustained", "sudden"))
    assert time.lean == pytest.approx(-0.6) and vertical.value == "rising"
    assert leanings(None) == ()


def test_facing_is_said_in_words():
    said = [facing_words(each) for each in (0, 45, 180, 270, 359.7)]
    assert said == ["front", "45° left", "back", "90° right", "front"]
