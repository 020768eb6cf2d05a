"""The evaluation itself, on the synthetic performer: what it may use, what it must say, and that it is repeatable."""

import dataclasses
import json

import numpy as np
import pytest

from common.errors import BadInput
from observer.geometry.views import parse_view
from observer.motion.archive import MotionArchive, Recording
from studies.evaluate import EvaluationSettings, evaluate
from studies.performer import perform, perform_continuously
from studies.report import as_json, as_text, resolved_pairs, write_report
from studies.stream import StreamVerdict, judge_streams, score
from studies.through import fused_over_mesh

LABELS = ("ok", "shake", "lunging")
DOOR_WHEEL = (parse_view("door"), parse_view("wheel"))


@pytest.fixture(scope="module")
def archive():
    return perform(("1", "2", "3"), LABELS, trials=2, seed=3)


def question(**given):
    return EvaluationSettings(**{"views": DOOR_WHEEL, "labels": LABELS, "train_subjects": ("1", "2"), **given})


@pytest.fixture(scope="module")
def answer(archive):
    return evaluate(archive, question())


def test_the_json_holds_what_the_contract_names(answer):
    said = json.loads(json.dumps(as_json(answer)))
    assert said["version"] == 1 and said["n_train"] == 12 and said["n_test"] == 6
    assert set(said["accuracy_at"]) == {"0.2", "0.4", "0.6", "0.8", "1.0"}
    assert np.array(said["confusion"]).sum() == 6
    for view in said["per_view"].values():
        assert {"accuracy", "accuracy_at", "mean_entropy_bits"} <= view.keys()
    assert {"labels", "views", "model", "rule", "accuracy", "ece", "brier", "log_loss"} <= said.keys()
    assert {"seconds_per_frame", "train_seconds"} <= said.keys()


def test_nothing_after_the_fraction_is_used(archive, answer):
    """Cutting the test recordings short after 60 % leaves every belief up to there as it was."""
    whole = {j.trial.name: j for j in answer.trials}
    short = MotionArchive(
        archive.body_parts, tuple(_shortened(r) if r.subject == "3" else r for r in archive.recordings)
    )
    for judged in evaluate(short, question()).trials:
        frames = len(judged.fused)
        assert whole[judged.trial.name].fused[:frames] == pytest.approx(judged.fused)


def _shortened(recording):
    return dataclasses.replace(recording, positions=recording.positions[: int(len(recording.positions) * 0.6)])


def test_the_same_seed_gives_the_same_answer(archive):
    asked = question(onset_known=False, turn=None, seed=5)
    one, two, other = evaluate(archive, asked), evaluate(archive, asked), evaluate(archive, question(onset_known=False))
    assert (one.at_end()[1] == two.at_end()[1]).all()
    assert not (one.at_end()[1] == other.at_end()[1]).all()


def test_everybody_is_judged_once_when_each_is_left_out_in_turn(archive):
    answer = evaluate(archive, question(train_subjects=(), leave_one_subject_out=True))
    assert len(answer.trials) == len(archive.recordings)
    assert len({j.trial.name for j in answer.trials}) == len(archive.recordings)


@pytest.mark.parametrize("fault", ["wrong", "noise", "silent", "late"])
def test_a_faulty_view_changes_its_own_beliefs_only(archive, answer, fault):
    disturbed = evaluate(archive, question(faults={"wheel": fault}))
    for sound, ill in zip(answer.trials, disturbed.trials, strict=True):
        assert (sound.views[:, 0] == ill.views[:, 0]).all()
        assert not (sound.views[:, 1] == ill.views[:, 1]).all()


def test_over_the_mesh_the_labels_are_the_same(answer):
    said = fused_over_mesh(answer)
    assert said["same_labels"] == said["n"] == 6


def test_the_report_is_written_and_read(answer, tmp_path):
    said = as_json(answer)
    files = write_report(answer, said, tmp_path / "new" / "folder")
    assert {f.name for f in files} >= {"report.txt", "confusion-door.png", "confusion-fused.png", "reliability.png"}
    assert all(f.stat().st_size > 100 for f in files)
    assert "12 recordings learned, 6 judged" in as_text(said) and "resolves" in resolved_pairs(said)
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match="--report"):
        write_report(answer, said, tmp_path / "file")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"labels": ("ok", "jump")}, "'jump' is in no recording; known: ok, shake, lunging"),
        ({"train_subjects": ("1", "9")}, "subject '9': not in the archive; it has 1, 2, 3"),
        ({"train_subjects": ("1",), "test_subjects": ("1",)}, "both in training and in test"),
        ({"model": "phas"}, "did you mean 'phase'"),
        ({"parameters": {"bin": 8}}, "parameter 'bin': not of the model phase; it has sharpness"),
        ({"rule": "logg"}, "did you mean 'log'"),
        ({"body_parts": ("left_foot", "head")}, "'left_foot': not in the recording"),
    ],
)
def test_what_cannot_be_asked_is_one_clear_line(archive, given, said):
    with pytest.raises(BadInput, match=said) as caught:
        evaluate(archive, question(**given))
    assert "\n" not in str(caught.value)


def test_streams_of_movements_are_spotted(archive):
    stream = perform_continuously("3", LABELS, seed=1)
    both = MotionArchive(archive.body_parts, (*archive.recordings, stream))
    said = judge_streams(both, question(test_subjects=("3",)))
    assert said["recall"] >= 2 / 3 and said["false_alarms_per_minute"] == 0
    assert 0 < said["median_latency_s"] < 3


def test_scoring_alarms_by_hand():
    from observer.motion.archive import Span

    stream = Recording(
        np.zeros((150, 3, 3), np.float32), 15.0, "", "1", "1", (Span(15, 45, "ok"), Span(75, 105, "shake"))
    )
    said = [("ok", 0.7), ("ok", 2.0), ("ok", 6.0), ("shake", 4.0), ("shake", 7.33), ("abstain", 1.0)]
    alarms = [StreamVerdict(label, at_s, label) for label, at_s in said]
    counts = score(alarms, stream, ("ok", "shake"))
    # .7 s is within 333 ms of the span; the second ok is one too many; ok at 6 s is wrong; 4 s is rest.
    assert (counts.right, counts.false, counts.movements, counts.alarms_at_rest) == (2, 3, 2, 1)
    assert counts.rest_s == pytest.approx(6.0)
    assert counts.latencies_s == pytest.approx((-0.3, 2.33))


def test_who_names_what_was_not_learned_is_told_so():
    from observer.motion.archive import Span

    spans = (Span(15, 45, "ok"), Span(75, 105, "jump"), Span(120, 135, "jump"))
    stream = Recording(np.zeros((150, 3, 3), np.float32), 15.0, "", "1", "1", spans)
    counts = score([StreamVerdict("ok", 2.0, "ok"), StreamVerdict("shake", 6.0, "ok")], stream, ("ok", "shake"))
    assert (counts.right, counts.false, counts.movements) == (1, 1, 1)
    assert (counts.unlearned, counts.labelled, counts.alarms_at_rest) == (2, 1, 0)
    assert counts.as_json()["unlearned_named"] == 0.5
