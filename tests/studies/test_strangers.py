"""Which movements are shown unlearned and which are background, and what an evaluation with both says."""

import pytest

from common.errors import BadInput
from observer.geometry.views import parse_view
from studies.evaluate import EvaluationSettings, evaluate, folds_of
from studies.performer import perform
from studies.report import extra_text
from studies.stream import THRESHOLDS, judge_streams
from studies.trials import unlearned_and_background

KNOWN = ("a", "b", "c", "d", "e")
LEARNED = ("a", "b")


def test_who_is_what():
    assert unlearned_and_background("", "", LEARNED, KNOWN) == ((), None)
    assert unlearned_and_background("others", "", LEARNED, KNOWN) == (("c", "d", "e"), None)
    assert unlearned_and_background("c", "blends", LEARNED, KNOWN) == (("c",), ())
    assert unlearned_and_background("others", "d", LEARNED, KNOWN) == (("c", "e"), ("d",))
    assert unlearned_and_background("c,e", "d", LEARNED, KNOWN) == (("c", "e"), ("d",))


def test_a_number_is_drawn_from_the_unlearned_and_shown_no_more():
    draws = set()
    for seed in range(20):
        shown, background = unlearned_and_background("others", "2", LEARNED, KNOWN, seed)
        assert len(background) == 2 and sorted(shown + background) == ["c", "d", "e"]
        assert unlearned_and_background("others", "2", LEARNED, KNOWN, seed) == (shown, background)
        draws.add(background)
    assert len(draws) == 3


@pytest.mark.parametrize(
    ("unlearned", "background", "said"),
    [
        ("a", "", "--unlearned: 'a' is one of the learned movements"),
        ("others", "b", "--background-labels: 'b' is one of the learned movements"),
        ("c,d", "d", "--background-labels: 'd' is also in --unlearned"),
        ("others", "3", "--background-labels 3: needs 1 to one less than the 3 movements"),
        ("", "1", "--background-labels 1: needs 1 to one less than the 0 movements"),
        ("others", "0", "--background-labels 0"),
    ],
)
def test_what_cannot_be_is_one_line(unlearned, background, said):
    with pytest.raises(BadInput, match=r"\A[^\n]*\Z") as refused:
        unlearned_and_background(unlearned, background, LEARNED, KNOWN)
    assert said in str(refused.value)


@pytest.fixture(scope="module")
def archive():
    return perform(("1", "2", "3"), ("ok", "shake", "lunging", "byebye"), trials=1, seed=3)


def question(**given):
    return EvaluationSettings(
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
    assert [j.trial.recording.label for j in answer.trials] == ["ok", "shake"]
    assert all((j.unlearned > 0).all() for j in answer.trials)


def test_a_stream_says_what_each_threshold_names_and_keeps(archive):
    said = judge_streams(archive, question(unlearned=("byebye",)))
    assert said["unlearned"] == 1 and {"recall_last_word", "unlearned_named_last_word"} <= said.keys()
    rows = said["by_threshold"]
    assert [row["threshold"] for row in rows] == list(THRESHOLDS)
    (usual,) = [row for row in rows if row["threshold"] == 0.8]
    assert usual == {name: value for name, value in said.items() if name != "by_threshold"} | {"threshold": 0.8}
    text = "\n".join(extra_text({"stream": said}))
    assert text.count("0.95 ") == 1 and "by the last word" in text
    assert judge_streams(archive, question())["by_threshold"] == []
