"""Which movements are shown unlearned and which are background, and what an evaluation with both says."""

import pytest

from common.errors import BadInput
from observer.geometry.views import parse_view
from studies.evaluate import Question, evaluate, folds_of
from studies.performer import perform
from studies.report import _extras
from studies.stream import THRESHOLDS, judge_stream
from studies.trials import strangers

KNOWN = ("a", "b", "c", "d", "e")
LEARNED = ("a", "b")


def test_who_is_what():
    assert strangers("", "", LEARNED, KNOWN) == ((), None)
    assert strangers("others", "", LEARNED, KNOWN) == (("c", "d", "e"), None)
    assert strangers("c", "blends", LEARNED, KNOWN) == (("c",), ())
    assert strangers("others", "d", LEARNED, KNOWN) == (("c", "e"), ("d",))
    assert strangers("c,e", "d", LEARNED, KNOWN) == (("c", "e"), ("d",))


def test_a_number_is_drawn_from_the_unlearned_and_shown_no_more():
    draws = set()
    for seed in range(20):
        shown, background = strangers("others", "2", LEARNED, KNOWN, seed)
        assert len(background) == 2 and sorted(shown + background) == ["c", "d", "e"]
        assert strangers("others", "2", LEARNED, KNOWN, seed) == (shown, background)
        draws.add(background)
    assert len(draws) == 3


@pytest.mark.parametrize(
    ("unlearned", "background", "said"),
    [
        ("a", "", "--unlearned: 'a' is among the movements that are learned"),
        ("others", "b", "--background-labels: 'b' is among the movements that are learned"),
        ("c,d", "d", "--background-labels: 'd' is among --unlearned, which must not be known"),
        ("others", "3", "--background-labels 3: of 3 movements of --unlearned"),
        ("", "1", "--background-labels 1: of 0 movements of --unlearned"),
        ("others", "0", "--background-labels 0"),
    ],
)
def test_what_cannot_be_is_one_line(unlearned, background, said):
    with pytest.raises(BadInput, match=r"\A[^\n]*\Z") as refused:
        strangers(unlearned, background, LEARNED, KNOWN)
    assert said in str(refused.value)


@pytest.fixture(scope="module")
def archive():
    return perform(("1", "2", "3"), ("ok", "shake", "lunging", "byebye"), trials=1, seed=3)


def question(**given):
    return Question(
        views=(parse_view("door"),),
        labels=("ok", "shake"),
        train_subjects=("1", "2"),
        calibrated=False,
        **{"background": ("lunging",), **given},
    )


def test_what_else_there_is_is_learned_of_the_training_people_and_nobody_is_judged_by_it(archive):
    (fold,) = folds_of(archive, question(), ("ok", "shake", "byebye"))
    assert {(r.subject, r.label) for r in fold.train.recordings if r.label == "lunging"} == {
        ("1", "lunging"),
        ("2", "lunging"),
    }
    assert {(r.subject, r.label) for r in fold.test} == {("3", label) for label in ("ok", "shake", "byebye")}
    answer = evaluate(archive, question())
    assert [j.trial.recording.label for j in answer.judged] == ["ok", "shake"]
    assert all((j.unlearned > 0).all() for j in answer.judged)


def test_a_stream_says_what_each_threshold_names_and_keeps(archive):
    said = judge_stream(archive, question(unlearned=("byebye",)))
    assert said["unlearned"] == 1 and {"recall_last_word", "unlearned_named_last_word"} <= said.keys()
    rows = said["by_threshold"]
    assert [row["threshold"] for row in rows] == list(THRESHOLDS)
    (usual,) = [row for row in rows if row["threshold"] == 0.8]
    assert usual == {name: value for name, value in said.items() if name != "by_threshold"} | {"threshold": 0.8}
    text = "\n".join(_extras({"stream": said}))
    assert text.count("0.95 ") == 1 and "when the last word counts" in text
    assert judge_stream(archive, question())["by_threshold"] == []
