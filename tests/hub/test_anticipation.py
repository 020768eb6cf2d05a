"""Early words: each is confirmed, corrected or withdrawn once under its id, in whatever order messages arrive."""

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.vocabulary import ABSTAIN
from hub.anticipation import CLOSED_LIMIT, ENDED_S, NEVER, SILENT_S, Anticipation

SURE, UNSURE, OTHER = (0.02, 0.03, 0.05, 0.9), (0.2, 0.2, 0.2, 0.4), (0.02, 0.03, 0.9, 0.05)


@pytest.fixture
def started(make):
    """An anticipation that has received an uncertain judgement from before the movement."""
    anticipation = Anticipation(0.8)
    assert anticipation.update(make.judgement(p=UNSURE), 0.0) == []
    return anticipation


def stages(words):
    return [(word.stage, word.id, word.label, word.early) for word in words]


@pytest.mark.parametrize(("label", "stage"), [("nthrow", "confirmed"), ("ok", "corrected"), (ABSTAIN, "withdrawn")])
def test_only_the_last_verdict_settles_an_early_word(make, started, label, stage):
    assert started.update(make.moving(p=UNSURE), 0.0) == []
    (word,) = started.update(make.moving(p=SURE), 0.1)
    assert (word.stage, word.label, word.p) == ("early", "nthrow", pytest.approx(0.9)) and started.open == (word,)
    assert started.update(make.moving(p=SURE), 0.2) == [] == started.update(make.verdict(1, label="maestro"), 0.3)
    end = make.verdict(1, ended_ns=make.NOON, label=label)
    assert stages(started.update(end, 0.4)) == [(stage, "v1", label, "nthrow")]
    for late in (end, make.moving(p=SURE), make.moving(p=UNSURE), make.moving(p=SURE)):
        assert started.update(late, 0.5) == [], "no words after its end"
    assert started.open == ()


def test_a_label_that_is_still_probable_from_the_movement_before_is_not_early(make):
    anticipation = Anticipation(0.8)
    anticipation.update(make.judgement(p=SURE), 0.0)
    assert anticipation.update(make.moving(p=SURE), 0.1) == [] == anticipation.update(make.moving(p=SURE), 0.2)
    assert anticipation.update(make.moving(p=UNSURE), 0.3) == []
    assert len(anticipation.update(make.moving(p=SURE), 0.4)) == 1, "improbable and probable again: it is done again"
    assert len(anticipation.update(make.moving(number=2, p=OTHER, label="ok"), 0.5)) == 1, "another label is new"
    joined = Anticipation(0.8)
    assert joined.update(make.moving(p=SURE), 0.0) == [], "nothing is known from before the movement"
    assert len(joined.update(make.moving(p=OTHER, label="ok"), 0.1)) == 1


def test_a_decided_movement_is_not_early_and_neither_is_any_at_certainty_one(make, started):
    assert started.update(make.moving(p=SURE, decided="nthrow"), 0.0) == []
    assert started.update(make.verdict(1), 0.0) == [] == started.update(make.moving(p=SURE), 0.1)
    never = Anticipation(NEVER)
    certain = make.moving(p=(0.0, 0.0, 0.0, 1.0))
    assert never.update(make.judgement(p=UNSURE), 0.0) == [] == never.update(certain, 0.1)


def test_a_word_without_a_verdict_is_withdrawn(make):
    for after in (make.judgement(), make.moving(number=2, p=UNSURE)):
        anticipation = Anticipation(0.8)
        anticipation.update(make.judgement(p=UNSURE), 0.0)
        anticipation.update(make.moving(p=SURE), 0.0)
        assert anticipation.update(after, 0.1) == [] == anticipation.expire(0.1 + ENDED_S), "its verdict may follow"
        assert stages(anticipation.expire(0.2 + ENDED_S)) == [("withdrawn", "v1", ABSTAIN, "nthrow")]
        assert anticipation.update(make.verdict(1, ended_ns=make.NOON), 1.0) == [], "too late: it was withdrawn"


def test_another_fusion_service_may_continue_the_movement(make, started):
    started.update(make.moving(p=SURE), 0.0)
    assert started.expire(SILENT_S) == []
    standby = make.moving(p=SURE).model_copy(update={"fusion": "fuse2"})
    assert started.update(standby, SILENT_S) == [] == started.expire(2 * SILENT_S)
    assert stages(started.expire(2 * SILENT_S + 0.1)) == [("withdrawn", "v1", ABSTAIN, "nthrow")]


NUMBERS = st.integers(0, 2)
LABELS = st.sampled_from(("nthrow", "ok", ABSTAIN))
STEPS = st.one_of(
    st.tuples(st.just("moving"), NUMBERS, st.sampled_from((SURE, UNSURE)), st.sampled_from((None, "ok"))),
    st.tuples(st.just("rest")),
    st.tuples(st.just("verdict"), NUMBERS, LABELS, st.booleans()),
    st.tuples(st.just("pause"), st.floats(0, 2 * SILENT_S)),
)


@given(st.lists(STEPS, max_size=60), st.floats(0.0, 0.95))
def test_every_early_word_is_settled_exactly_once(make, steps, certainty):
    anticipation, now_s, words = Anticipation(certainty), 0.0, []
    for kind, *more in steps:
        now_s += 0.1
        match kind:
            case "moving":
                words += anticipation.update(make.moving(number=more[0], p=more[1], decided=more[2]), now_s)
            case "rest":
                words += anticipation.update(make.judgement(), now_s)
            case "verdict":
                ended_ns = make.NOON if more[2] else None
                words += anticipation.update(make.verdict(more[0], ended_ns=ended_ns, label=more[1]), now_s)
            case "pause":
                now_s += more[0]
                words += anticipation.expire(now_s)
    words += anticipation.expire(now_s + SILENT_S + 0.1)
    began, ended = [w.id for w in words if w.stage == "early"], [w.id for w in words if w.stage != "early"]
    assert len(set(began)) == len(began) and Counter(began) == Counter(ended) and anticipation.open == ()
    for word in words:
        assert words.index(word) >= began.index(word.id)
        assert (word.label == word.early) == (word.stage in ("early", "confirmed"))
        assert (word.label == ABSTAIN) == (word.stage == "withdrawn")


def test_its_memory_is_bounded(make, started):
    for number in range(3 * CLOSED_LIMIT):
        started.update(make.moving(number=number, p=UNSURE), float(number))
        assert len(started.update(make.moving(number=number, p=SURE), float(number))) == 1
        started.update(make.verdict(number, ended_ns=make.NOON), number + 0.1)
    assert len(started._closed) == CLOSED_LIMIT and started.open == ()
