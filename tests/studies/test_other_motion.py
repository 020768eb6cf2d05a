"""Streams in which no movement happens, first words, results before calibration, and several processes."""

import json
from dataclasses import replace

import numpy as np
import pytest
import typer

from common.config_sections import FusionConfig
from common.errors import BadInput
from observer.geometry.views import parse_view
from observer.motion.archive import MotionArchive, Recording, Span
from observer.motion.archive_file import write_archive
from studies.commands import evaluate as evaluate_command
from studies.evaluate import results_of
from studies.observing import observe_folds
from studies.performer import perform, perform_continuously
from studies.report import as_json
from studies.settings import EvaluationSettings
from studies.spotting import JudgedStream, StreamResult, StreamVerdict
from studies.stream import judge_observed

LABELS = ("ok", "shake", "lunging")


@pytest.fixture(scope="module")
def archive():
    return perform(("1", "2", "3"), LABELS, trials=2, seed=3)


def settings(**changes):
    views = (parse_view("door"), parse_view("wheel"))
    return EvaluationSettings(**{"views": views, "labels": LABELS, "leave_one_subject_out": True, **changes})


def telling(archive, subject, rate_hz=15.0):
    """A person who does what nobody learns, at another rate and with one part more."""
    shown = perform_continuously(subject, ("byebye", "maestro"), seed=2)
    positions = np.concatenate([shown.positions, shown.positions[:, :1]], axis=1)
    return Recording(positions, rate_hz, "", subject, "1")


ASKED = settings(leave_one_subject_out=False, train_subjects=("1", "2"), model="phase")


def test_several_processes_give_the_same_result_as_one(archive):
    """With streams and other motion."""
    other = (perform_continuously("4", ("byebye",), seed=2),)
    asked = replace(ASKED, other_motion=other, train_subjects=("1",), test_subjects=("2",), model="frame-table")
    one, two = (observe_folds(archive, asked, jobs=jobs, streams=True) for jobs in (1, 2))
    pairs = zip(*(results_of(folds, asked).trials for folds in (one, two)), strict=True)
    assert all((mine.fused == theirs.fused).all() for mine, theirs in pairs)
    assert judge_observed(one, asked).as_json() == judge_observed(two, asked).as_json()


@pytest.fixture(scope="module")
def observed(archive):
    """What the observers output."""
    return observe_folds(archive, ASKED)


def test_the_first_word_is_said_within_the_movement_and_counted(observed):
    result = results_of(observed, ASKED)
    figures = as_json(result)
    words = [r for r in result.trials if r.first_word]
    assert figures["first_word"]["coverage"] == len(words) / len(result.trials) > 0.5
    assert figures["first_word"]["accuracy"] == sum(r.first_word[1] == r.truth for r in words) / len(words) > 0.5
    assert 0 < figures["first_word"]["median_fraction"] <= 1 and 0 <= figures["ece_first_word"] <= 1
    for r in words:
        frame, label = r.first_word
        assert r.fused[frame].argmax() == label and r.fused[frame, label] >= FusionConfig().threshold


def test_counts_of_other_motion_by_hand():
    def stream(subject, *labels):
        recording = Recording(np.zeros((900, 3, 3), np.float32), 15.0, "", subject, "1")
        words = [StreamVerdict(first, 10.0 * n, last) for n, (first, last) in enumerate(labels)]
        return JudgedStream(recording, words)

    spans = (Span(2, 5, "ok"), Span(6, 8, "shake"))
    moving = replace(stream("a").recording, positions=np.zeros((10, 3, 3), np.float32), spans=spans)
    spoken = JudgedStream(moving, [], ["", "", "", "ok", "ok", "ok", "", "shake", "", ""])
    # Wrong in frames 2, 5 and 7; shake was not learned.
    assert StreamResult(("ok",), (spoken,), (), {}).as_json()["frames_right"] == 0.7
    talker = stream("a", ("ok", "ok"), ("ok", "abstain"), ("abstain", "abstain"))
    result = StreamResult(("ok",), (), (talker, stream("b")), {})
    figures = result.as_json()["other_motion"]
    assert figures["minutes"] == 2 and figures["named_per_minute"] == 1
    assert figures["named_per_minute_last_word"] == figures["abstentions_per_minute"] == 0.5
    assert figures["abstentions_per_minute_last_word"] == 1
    assert figures["per_person"]["a"]["named_per_minute"] == 2 and figures["per_person"]["b"]["named_per_minute"] == 0


@pytest.fixture
def command(tmp_path, monkeypatch, capsys, archive):
    monkeypatch.chdir(tmp_path)
    write_archive(tmp_path / "own.npz", archive)
    story = tuple(telling(archive, subject, 30.0) for subject in ("3", "4"))
    write_archive(tmp_path / "story.npz", MotionArchive((*archive.body_parts, "nose"), story))
    app = typer.Typer(add_completion=False)
    app.command()(evaluate_command)

    def call(*words):
        main = typer.main.get_command(app).main
        main(["own.npz", "--views", "door", "--jobs", "1", *map(str, words)], standalone_mode=False)
        return capsys.readouterr().out

    return call


def test_other_motion_is_judged_of_those_who_are_no_background(command, tmp_path):
    words = ["--other-motion", "story.npz", "--background", "story.npz", "--uncalibrated"]
    out = command(*words, "--background-subjects", "3", "--json", "out.json", "--report", "out")
    assert "other motion, " in out and "by person: 4 " in out
    other = json.loads((tmp_path / "out.json").read_text())["stream"]["other_motion"]
    assert set(other["per_person"]) == {"4"}
    assert other["minutes"] == pytest.approx(len(telling(None, "4").positions) / 30 / 60, rel=0.01)
    assert (tmp_path / "out" / "other-motion-4.png").exists()
    with pytest.raises(BadInput, match=r"--other-motion story\.npz: all its people are learned from"):
        command(*words)


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (["--background-subjects", "3"], "--background-subjects 3: of which archive?"),
        (["--background", "cluttred"], "--background cluttred: an archive"),
        (["--other-motion", "own.npz"], "--other-motion own.npz: 'ok' is a movement of the archive"),
        (["--other-motion", "story.npz", "--body-parts", "head,left_foot"], "body part 'left_foot': not in the"),
    ],
)
def test_bad_archives_are_one_line(command, words, error):
    with pytest.raises(BadInput) as caught:
        command(*words)
    assert str(caught.value).startswith(error) and "\n" not in str(caught.value)
