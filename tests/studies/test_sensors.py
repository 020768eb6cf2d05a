"""Several sensors that recorded the same performances: matched, compared at equal fractions, judged by who has them."""

import dataclasses
import json
import re

import numpy as np
import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st

from common.errors import BadInput
from labanmesh import main
from observer.geometry.views import View, parse_view
from observer.model.phase import Phase
from observer.model.registry import MODELS
from observer.motion.archive import MotionArchive, Recording, retime
from observer.motion.archive_file import read_archive, write_archive
from studies.commands import evaluate as evaluate_command
from studies.evaluate import evaluate
from studies.evaluated_archives import BackgroundArchives, read_archives
from studies.performer import perform, perform_continuously
from studies.report import as_json
from studies.sensors import frames_at_fractions, performances, read_sensors
from studies.settings import EvaluationSettings
from studies.stream import judge_streams

LABELS = ("ok", "shake", "lunging")
VIEWS = tuple(View(name, parse_view(seen_from).matrix) for name, seen_from in (("left", "door"), ("right", "wheel")))


@pytest.fixture(scope="module")
def archive():
    return perform(("1", "2", "3"), LABELS, trials=2, seed=3)


def settings(**changes):
    common = {"views": VIEWS, "labels": LABELS, "train_subjects": ("1", "2"), "model": "phase", "calibrated": False}
    return EvaluationSettings(**{**common, **changes})


def with_recordings(archive, recordings):
    return MotionArchive(archive.body_parts, tuple(recordings))


@given(st.integers(1, 200), st.integers(1, 200))
def test_no_frame_is_later_than_its_fraction_and_the_last_is_the_end(frames, wanted):
    places = frames_at_fractions(frames, wanted)
    assert places[-1] == frames - 1 and (np.diff(places) >= 0).all()
    for n, place in enumerate(places.tolist()):
        assert place / frames < (n + 1) / wanted + 1e-9 <= (place + 2) / frames + 1e-6 or place == 0
    assert frames_at_fractions(frames, frames).tolist() == list(range(frames))


def test_sensors_without_the_same_movements_are_refused_with_the_way_out(archive, tmp_path, capsys):
    for name, labels in {"left": LABELS[:2], "right": LABELS[1:], "door": LABELS[2:]}.items():
        shown = with_recordings(archive, [r for r in archive.recordings if r.label in labels])
        write_archive(tmp_path / f"{name}.npz", shown)
    left, right, door = (f"--sensor={name}={tmp_path / name}.npz" for name in ("left", "right", "door"))
    both = "left: no recording shows lunging; record it with this sensor too, or leave it out: --labels shake"
    neither = "--sensor: none of the movements was recorded by all sensors (left has ok, shake; door has lunging)"
    unknown = "--labels shaek: no recording shows this movement; did you mean shake?"
    for verb, last in (("evaluate", ("--train-subjects", "1")), ("learn", ("-o", str(tmp_path / "models")))):
        for words, line in (((right,), both), ((door,), neither), ((right, "--labels", "shaek"), unknown)):
            assert main([verb, left, *words, *last]) == 2
            assert line in capsys.readouterr().err


def test_two_sensors_that_recorded_the_same_are_two_views_of_one_archive(archive):
    """Oracle: the evaluation of views, also of streams."""
    by_sensors, by_views = settings(sensors=(archive, archive)), settings()
    one, other = (evaluate(archive, s) for s in (by_sensors, by_views))
    for mine, theirs in zip(one.trials, other.trials, strict=True):
        np.testing.assert_array_equal(mine.views, theirs.views)
        np.testing.assert_array_equal(mine.fused, theirs.fused)
        assert mine.first_word == theirs.first_word
    assert judge_streams(archive, by_sensors) == judge_streams(archive, by_views)
    figures = as_json(one)
    assert figures["complete"]["accuracy_at"] == figures["accuracy_at"] and figures["complete"]["n_test"] == 6


def test_a_performance_is_judged_by_the_sensors_that_have_it(archive):
    lacking = [r for r in archive.recordings if (r.label, r.subject, r.trial) != ("ok", "3", "1")]
    sensors = (archive, with_recordings(archive, lacking))
    result = evaluate(performances(sensors), settings(sensors=sensors, rule="product"))
    (alone,) = [r for r in result.trials if not r.judged_by.all()]
    assert alone.trial.name == "ok 3.1" and alone.judged_by.tolist() == [True, False]
    assert alone.fused == pytest.approx(alone.views[:, 0], abs=1e-9)
    figures = as_json(result)
    assert [figures["per_view"][name]["n_test"] for name in ("left", "right")] == [6, 5]
    assert figures["complete"]["n_test"] == 5 and figures["n_test"] == 6
    assert np.array(figures["per_view"]["right"]["confusion"]).sum() == 5
    assert 0 <= judge_streams(performances(sensors), settings(sensors=sensors))["f1"] <= 1


def test_a_faulty_sensor_says_nothing_about_what_it_did_not_record(archive):
    lacking = [r for r in archive.recordings if (r.label, r.subject) != ("ok", "3")]
    sensors = (archive, with_recordings(archive, lacking))
    result = evaluate(performances(sensors), settings(sensors=sensors, faults={"right": "wrong"}))
    for r in result.trials:
        assert np.isfinite(r.fused).all() and r.judged_by[0]
        assert not r.judged_by[1] or r.trial.recording.label != "ok"
        assert np.isnan(r.views[:, 1]).all() == (not r.judged_by[1])


def test_each_sensor_sees_its_own_recording_and_is_compared_at_equal_fractions(archive):
    slower = with_recordings(archive, [retime(r, 0.8) for r in archive.recordings])
    own = {r.trial.name: r.views[:, 0] for r in evaluate(slower, settings(views=VIEWS[1:])).trials}
    sensors = (archive, slower)
    for result in evaluate(performances(sensors), settings(sensors=sensors)).trials:
        frames = len(result.trial.recording.positions)
        mine = own[result.trial.name]
        np.testing.assert_array_equal(result.views[:, 1], mine[frames_at_fractions(len(mine), frames)])


@pytest.mark.parametrize(
    ("texts", "error"),
    [
        (["left=a.npz"], "--sensor left=a.npz: at least two sensors are needed"),
        (["a.npz", "b.npz"], "--sensor 'a.npz': NAME=FILE.npz or NAME=FILE.npz@VIEW is expected"),
        (["=a.npz", "b=b.npz"], "--sensor '=a.npz': NAME="),
        (["left=a.npz", "left=b.npz"], "--sensor left=b.npz: 'left' is given twice"),
        (["left=a.npz", "right=b.npz@dor"], "view 'dor': unknown view"),
        (["left=a.npz", "right=twice"], "--sensor right: two recordings of ok 1 1; give each another trial"),
        (["left=a.npz", "right=feet"], "--sensor: no body part that all have"),
        (["left=a.npz", "right=fast"], "--sensor: rates of 15 and 30 Hz"),
    ],
)
def test_bad_sensors_are_one_line(archive, texts, error):
    first = archive.recordings[0]
    kinds = {
        "twice": with_recordings(archive, (*archive.recordings, first)),
        "feet": MotionArchive(("l", "r", "n"), archive.recordings),
        "fast": with_recordings(archive, (dataclasses.replace(first, rate_hz=30.0),)),
    }
    with pytest.raises(BadInput, match=r"\A" + re.escape(error)) as caught:
        read_sensors(texts, lambda path: kinds.get(str(path), archive))
    assert "\n" not in str(caught.value)


def test_body_parts_are_those_that_all_sensors_have(archive):
    reordered = MotionArchive(
        ("nose", *archive.body_parts[::-1]),
        tuple(
            dataclasses.replace(r, positions=np.concatenate([r.positions[:, :1], r.positions[:, ::-1]], axis=1))
            for r in archive.recordings
        ),
    )
    views, (one, two) = read_sensors(["a=x", "b=y@wheel"], lambda path: archive if str(path) == "x" else reordered)
    assert [view.name for view in views] == ["a", "b"] and one.body_parts == two.body_parts == archive.body_parts
    np.testing.assert_array_equal(one.recordings[0].positions, two.recordings[0].positions)
    np.testing.assert_array_equal(views[1].matrix, parse_view("wheel").matrix)


WIDE = ("left_hand", "right_hand", "head", "left_foot")


@pytest.mark.parametrize(
    ("named", "recorded", "parts"),
    [
        ((), WIDE, WIDE),
        ((), (*WIDE[:2], "neck"), (*WIDE[:2], "neck")),
        (("all",), WIDE, WIDE),
        (("left_foot", "head"), WIDE, ("left_foot", "head")),
    ],
    ids=["default", "no head", "all", "named"],
)
def test_an_evaluation_reads_all_parts_unless_told_otherwise(archive, tmp_path, named, recorded, parts):
    positions = (np.concatenate([r.positions, r.positions[:, :1] - 1], axis=1) for r in archive.recordings)
    rows = [WIDE.index(part) if part in WIDE else 2 for part in recorded]
    wide = [dataclasses.replace(r, positions=p[:, rows]) for r, p in zip(archive.recordings, positions, strict=True)]
    write_archive(tmp_path / "wide.npz", MotionArchive(recorded, tuple(wide)))
    read = read_archives(tmp_path / "wide.npz", "door", (), named, BackgroundArchives(), ())
    assert read.body_parts == read.whole.body_parts == parts
    chosen = wide[0].positions[:, [recorded.index(part) for part in parts]]
    np.testing.assert_array_equal(read.whole.recordings[0].positions, chosen)


@pytest.fixture
def command(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    app = typer.Typer(add_completion=False)
    app.command()(evaluate_command)

    def call(*words):
        typer.main.get_command(app).main([str(word) for word in words], standalone_mode=False)
        return capsys.readouterr().out

    return call


def test_two_sensors_on_the_command_line(command, archive, tmp_path):
    write_archive(tmp_path / "a.npz", archive)
    write_archive(tmp_path / "b.npz", with_recordings(archive, archive.recordings[1:]))
    words = ["--sensor", "left=a.npz", "--sensor", "right=b.npz@wheel", "--labels", "ok,shake", "--rule", "product"]
    words += ["--leave-one-subject-out", "--jobs", "1", "--stream", "--model", "phase"]
    out = command(*words, "--report", "out", "--json", "out.json")
    assert "of 12 performances the sensors recorded: left 12, right 11; all of them 11 (complete)" in out
    figures = json.loads((tmp_path / "out.json").read_text())
    assert figures["views"] == ["left", "right"] and figures["rule"] == "product" and figures["sensors"]
    assert set(figures["stream"]["per_person"]) == {"1", "2", "3"}
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"stream-1.png", "stream-3.png", "confusion-right.png", "reliability.png"} <= names
    for extra, error in (
        (["a.npz"], "--sensor: takes the place of ARCHIVE and --views"),
        (["--turn", "45"], "--sensor --turn: sensors are judged on what they recorded; omit --turn"),
        (["--onset", "unknown"], "--sensor --onset unknown"),
    ):
        with pytest.raises(BadInput, match=error):
            command(*words, *extra)
    with pytest.raises(BadInput, match="ARCHIVE: which one"):
        command("--views", "door")
    assert read_archive(tmp_path / "a.npz").recordings[0].label == "ok"


class SpyModel(Phase):
    """The phase filter, which notes whose streams it learned from."""

    kind = "spy_model"
    learned = []  # noqa: RUF012

    @classmethod
    def learn_with_streams(cls, header, examples, streams):
        cls.learned.append(({e.subject for e in examples}, [(s.subject, len(s.tracks)) for s in streams]))
        return cls.learn(header, examples)

    def cross_validated(self, folds, watched):
        raise NotImplementedError


def test_each_sensor_learns_from_its_own_streams_of_the_training_people(archive, monkeypatch):
    monkeypatch.setitem(MODELS, "spy_model", SpyModel)
    SpyModel.learned.clear()
    streams = [dataclasses.replace(perform_continuously(s, LABELS, seed=1), subject=s) for s in "123"]
    life = Recording(streams[0].positions[:60], 15.0, "", "somebody", "1")
    longer = [dataclasses.replace(s, positions=np.concatenate([s.positions, s.positions[-1:]])) for s in streams]
    sensors = tuple(with_recordings(archive, [*archive.recordings, *own]) for own in (streams, longer))
    asked = settings(sensors=sensors, leave_one_subject_out=True, train_subjects=(), model="spy_model")
    asked = dataclasses.replace(asked, background_archive=with_recordings(archive, [life]))
    figures = judge_streams(performances(sensors), asked)
    assert figures["movements"] == 9 and set(figures["per_person"]) == {"1", "2", "3"}
    assert len(SpyModel.learned) == 6
    for n, (people, learned) in enumerate(SpyModel.learned):
        own = {r.subject: len(r.positions) for r in (streams, longer)[n % 2]}
        assert len(people) == 2 and sorted(learned) == sorted([*((s, own[s]) for s in people), ("somebody", 60)])
