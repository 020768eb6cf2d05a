"""The evaluation on the synthetic performer: what it may use, what it reports, and that it is repeatable."""

import dataclasses
import json
import sys

import numpy as np
import pytest

from common.errors import BadInput, LabanmeshError
from observer.geometry.views import parse_view
from observer.motion.archive import MotionArchive, Recording, Span
from observer.motion.archive_file import write_archive
from studies.commands import paper
from studies.evaluate import evaluate
from studies.output_files import require_writable
from studies.performer import perform, perform_continuously
from studies.report import as_json, prepare_report, write_report
from studies.report_text import as_text, resolved_pairs
from studies.settings import EvaluationSettings
from studies.spotting import StreamVerdict, score
from studies.stream import judge_streams

LABELS = ("ok", "shake", "lunging")
DOOR_WHEEL = (parse_view("door"), parse_view("wheel"))


@pytest.fixture(scope="module")
def archive():
    return perform(("1", "2", "3"), LABELS, trials=2, seed=3)


def settings(**changes):
    return EvaluationSettings(**{"views": DOOR_WHEEL, "labels": LABELS, "train_subjects": ("1", "2"), **changes})


def quick(**changes):
    """Settings of tests that are not about the model."""
    return settings(model="phase", calibrated=False, **changes)


@pytest.fixture(scope="module")
def result(archive):
    return evaluate(archive, quick())


def test_the_json_holds_what_the_contract_names(result):
    figures = json.loads(json.dumps(as_json(result)))
    assert figures["version"] == 1 and figures["n_train"] == 12 and figures["n_test"] == 6
    assert set(figures["accuracy_at"]) == {"0.2", "0.4", "0.6", "0.8", "1.0"}
    assert np.array(figures["confusion"]).sum() == 6
    for view in figures["per_view"].values():
        assert {"accuracy", "accuracy_at", "mean_entropy_bits"} <= view.keys()
    assert {"labels", "views", "model", "rule", "accuracy", "ece", "brier", "log_loss"} <= figures.keys()
    assert {"seconds_per_frame", "train_seconds"} <= figures.keys()


def test_nothing_after_the_fraction_is_used(archive, result):
    """Cutting the test recordings after 60 % leaves every posterior before the last, which is of the end, as it was."""

    def cut(recording):
        return dataclasses.replace(recording, positions=recording.positions[: int(len(recording.positions) * 0.6)])

    whole = {r.trial.name: r for r in result.trials}
    short = MotionArchive(archive.body_parts, tuple(cut(r) if r.subject == "3" else r for r in archive.recordings))
    for one in evaluate(short, quick()).trials:
        frames = len(one.fused) - 1
        assert whole[one.trial.name].fused[:frames] == pytest.approx(one.fused[:frames])


def test_the_same_seed_gives_the_same_result(archive):
    door = {"views": DOOR_WHEEL[:1], "onset_known": False}
    seeded = quick(**door, turn=None, seed=5)
    one, two, other = (evaluate(archive, s).at_end()[1] for s in (seeded, seeded, quick(**door)))
    assert (one == two).all() and not (one == other).all()


def test_leave_one_subject_out_judges_every_recording_once(archive):
    trials = evaluate(archive, quick(train_subjects=(), leave_one_subject_out=True)).trials
    assert len(trials) == len({r.trial.name for r in trials}) == len(archive.recordings)


def test_the_report_is_written_and_read(result, tmp_path):
    figures = as_json(result)
    files = write_report(result, figures, tmp_path / "new" / "folder")
    assert {f.name for f in files} >= {"report.txt", "confusion-door.png", "confusion-fused.png", "reliability.png"}
    assert all(f.stat().st_size > 100 for f in files)
    assert "12 recordings learned, 6 judged" in as_text(figures) and "resolves" in resolved_pairs(figures)
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match=r"cannot make the folder .* Choose another one with --report"):
        write_report(result, figures, tmp_path / "file")


def test_files_are_checked_before_the_long_work(tmp_path):
    require_writable(tmp_path / "out.json", "--json")
    assert not (tmp_path / "out.json").exists()
    for path in (tmp_path, tmp_path / "no" / "out.json"):
        with pytest.raises(BadInput, match=r"^cannot write .* Choose another path with --json$"):
            require_writable(path, "--json")


def test_a_report_without_matplotlib_is_refused_before_the_long_work(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "studies.figures", None)  # as if its import failed
    with pytest.raises(LabanmeshError, match=r"matplotlib is not installed; pip install 'labanmesh\[report\]'"):
        prepare_report(tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"labels": ("ok", "jump")}, "'jump' is in no recording; known: ok, shake, lunging"),
        ({"train_subjects": ("1", "9")}, "subject '9': not in the archive; it has 1, 2, 3"),
        ({"train_subjects": ("1",), "test_subjects": ("1",)}, "both in training and in test"),
        ({"model": "phas"}, "did you mean '?phase"),
        ({"parameters": {"bin": 8}}, "parameter 'bin'"),
        ({"rule": "logg"}, "did you mean '?log"),
        ({"body_parts": ("left_foot", "head")}, "'left_foot': not in the recording"),
    ],
)
def test_bad_settings_are_one_clear_line(archive, changes, error):
    with pytest.raises(BadInput, match=error) as caught:
        evaluate(archive, settings(**changes))
    assert "\n" not in str(caught.value)


def test_movements_in_streams_are_spotted(archive):
    stream = perform_continuously("3", LABELS, seed=1)
    both = MotionArchive(archive.body_parts, (*archive.recordings, stream))
    figures = judge_streams(both, settings(test_subjects=("3",), calibrated=False))
    assert figures["recall"] >= 2 / 3 and figures["false_alarms_per_minute"] == 0
    assert 0 < figures["median_latency_s"] < 3


def test_scoring_verdicts_by_hand():
    positions = np.zeros((150, 3, 3), np.float32)
    stream = Recording(positions, 15.0, "", "1", "1", (Span(15, 45, "ok"), Span(75, 105, "shake")))
    words = [("ok", 0.7), ("ok", 2.0), ("ok", 6.0), ("shake", 4.0), ("shake", 7.33), ("abstain", 1.0)]
    counts = score([StreamVerdict(label, at_s, label) for label, at_s in words], stream, ("ok", "shake"))
    # .7 s is within 333 ms of the span; the second ok is one too many; ok at 6 s is wrong; 4 s is rest.
    assert (counts.right, counts.false, counts.movements, counts.alarms_at_rest) == (2, 3, 2, 1)
    assert counts.rest_s == pytest.approx(6.0)
    assert counts.latencies_s == pytest.approx((-0.3, 2.33))
    # A label on an unlearned movement counts as labelled.
    stream = dataclasses.replace(stream, spans=(Span(15, 45, "ok"), Span(75, 105, "jump"), Span(120, 135, "jump")))
    counts = score([StreamVerdict("ok", 2.0, "ok"), StreamVerdict("shake", 6.0, "ok")], stream, ("ok", "shake"))
    assert (counts.right, counts.false, counts.movements) == (1, 1, 1)
    assert (counts.unlearned, counts.labelled, counts.alarms_at_rest) == (2, 1, 0)
    assert counts.as_json()["unlearned_named"] == 0.5


def test_all_three_are_printed_beside_the_papers(tmp_path, capsys):
    archive = tmp_path / "synthetic.npz"
    write_archive(archive, perform(("1", "2"), LABELS, trials=1, seed=1))
    paper(archive, report=tmp_path / "out")
    text = capsys.readouterr().out
    for title in ("Table I:", "Table II:", "Table III:", "32(of 95)", "all, confusions of one view"):
        assert title in text
    assert "1: one camera on the Door plane" in text.splitlines()[-6]
    assert (tmp_path / "out" / "experiments.txt").read_text() in text
    assert (tmp_path / "out" / "all" / "confusion-fused.png").exists()
