"""Learning curves: the training people of each point, the common test people, and the output."""

import json

import numpy as np
import pytest

import labanmesh
from common.errors import BadInput
from observer.geometry.views import parse_view
from observer.motion.archive import MotionArchive, Recording
from observer.motion.archive_file import write_archive
from observer.tracks import BODY_PARTS
from studies import learning_curve as curves
from studies.evaluate import EvaluationSettings, evaluate
from studies.performer import perform
from studies.report import draw_learning_curve

LABELS = ("ok", "lunging")
FRONT = (parse_view("door"),)


def archive_of(counts):
    """counts: subject -> label -> how many; the recordings are empty."""
    positions = np.zeros((3, 3, 3), np.float32)
    recordings = [
        Recording(positions, 15.0, label, subject, str(n))
        for subject, shown in counts.items()
        for label, count in shown.items()
        for n in range(count)
    ]
    return MotionArchive(BODY_PARTS, tuple(recordings))


@pytest.fixture
def asked(monkeypatch):
    """Records the arguments of evaluations instead of running them."""
    calls = []

    def evaluate(archive, settings, *_):
        calls.append((archive, settings))
        return settings

    monkeypatch.setattr(curves, "evaluate", evaluate)
    monkeypatch.setattr(curves, "_point", lambda n, answers: {"n": n, "draws": len(answers)})
    return calls


def test_people_and_recordings_are_counted_up_and_the_same_are_judged(asked):
    both = dict.fromkeys(LABELS, 3)
    archive = archive_of(dict.fromkeys("abcdx", both))
    settings = EvaluationSettings(views=FRONT, labels=LABELS, train_subjects=("a", "b", "c", "d"))
    curve = curves.learning_curve(archive, settings)
    assert [(p["n"], p["draws"]) for p in curve["people"]] == [(1, 3), (2, 3), (3, 3), (4, 1)]
    assert [(p["n"], p["draws"]) for p in curve["recordings"]] == [(1, 3), (2, 3), (3, 1)]
    assert (curve["n_people"], curve["n_judged"]) == (4, 6)
    # All people with all recordings are on both curves and are evaluated once.
    assert len(asked) == 10 + 6
    assert {q.test_subjects for _, q in asked} == {("x",)}
    assert asked[0][1].train_subjects == ("a",) and asked[3][1].train_subjects == ("a", "b")
    assert len({q.train_subjects for _, q in asked[:3]}) == 3
    for archive, _ in asked[10:13]:
        learned = [r for r in archive.recordings if r.subject != "x"]
        assert len(learned) == 8 and len({(r.subject, r.label) for r in learned}) == 8
    assert {r.trial for r in asked[10][0].recordings if r.subject != "x"} == {"0"}


def test_only_groups_that_show_every_movement_are_learned_from(asked):
    counts = {"a": {"ok": 1}, "b": dict.fromkeys(LABELS, 1), "c": {"lunging": 1}, "x": dict.fromkeys(LABELS, 1)}
    archive = archive_of(counts)
    curves.learning_curve(archive, EvaluationSettings(views=FRONT, labels=LABELS, train_subjects=("a", "b", "c")))
    assert {q.train_subjects for _, q in asked} == {("b",), ("a", "b"), ("a", "c"), ("b", "c"), ("a", "b", "c")}


def test_a_large_test_set_is_sampled_evenly(asked, monkeypatch):
    monkeypatch.setattr(curves, "MOST_JUDGED", 5)
    archive = archive_of({s: dict.fromkeys(LABELS, 9) for s in "ax"})
    settings = EvaluationSettings(views=FRONT, labels=LABELS, train_subjects=("a",))
    assert curves.learning_curve(archive, settings)["n_judged"] == 5
    judged = {tuple((r.label, r.trial) for r in archive.recordings if r.subject == "x") for archive, _ in asked}
    assert len(judged) == 1
    labels = [label for label, _ in judged.pop()]
    assert sorted(labels.count(label) for label in LABELS) == [2, 3]


def test_leave_one_subject_out_is_rejected():
    archive = archive_of({"a": dict.fromkeys(LABELS, 1)})
    with pytest.raises(BadInput, match="--learning-curve --leave-one-subject-out"):
        curves.learning_curve(archive, EvaluationSettings(views=FRONT, labels=LABELS, leave_one_subject_out=True))


def test_the_command_prints_writes_and_draws_the_curve(capsys, tmp_path):
    archive = perform(("1", "2", "3"), LABELS, trials=2, seed=3)
    write_archive(tmp_path / "people.npz", archive)
    words = ["evaluate", tmp_path / "people.npz", "--json", tmp_path / "found.json", "--learning-curve"]
    words += ["--views", "door", "--train-subjects", "1,2", "--model", "frame-table"]
    assert labanmesh.main([str(word) for word in words]) == 0
    out = capsys.readouterr().out
    figures = json.loads((tmp_path / "found.json").read_text("utf-8"))
    curve = figures["learning_curve"]
    assert [p["n"] for p in curve["people"]] == [p["n"] for p in curve["recordings"]] == [1, 2]
    assert curve["people"][-1] == {**curve["recordings"][-1], "n": 2}
    # The last point is the evaluation itself.
    settings = EvaluationSettings(views=FRONT, labels=LABELS, train_subjects=("1", "2"), model="frame-table")
    whole = evaluate(archive, settings)
    last = curve["people"][-1]
    assert last["accuracy"] == figures["accuracy"] and last["examples"] == whole.n_train == 8
    assert "accuracy at the end by people learned from" in out and "by recordings of each of 2 people" in out
    assert draw_learning_curve(curve, tmp_path / "learning-curve.png").stat().st_size > 1000
