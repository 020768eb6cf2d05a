"""Models taught from one camera's own 2-D tracks: as good as from 3-D seen by it, and never mixed with others."""

import json
from dataclasses import replace

import numpy as np
import pytest

from common.errors import BadInput
from common.vocabulary import Vocabulary
from observer.geometry.views import parse_view, this_camera
from observer.learning.editing import add_movements
from observer.learning.learn import learn_view
from observer.model.base import Onset
from observer.model.model_file import read_model, write_model
from observer.motion.archive import MotionArchive, Recording, TracksCamera
from observer.motion.archive_file import read_archive, write_archive
from observer.motion.projected import projected, view_of, view_tracks
from studies.performer import perform, perform_continuously
from studies.settings import EvaluationSettings
from studies.stream import judge_streams

LABELS = ("ok", "shake")
PX = 213.0
SOFA = TracksCamera("sofa")


def in_px(archive):
    """The same tracks with another unit and origin: a camera's pixels."""
    moved = (replace(r, positions=r.positions * np.float32(PX) + np.float32(240)) for r in archive.recordings)
    return replace(archive, recordings=tuple(moved))


@pytest.fixture(scope="module")
def people():
    return perform(("1", "2"), LABELS, trials=3, seed=5)


@pytest.fixture(scope="module")
def sofa(people):
    return in_px(projected(people, parse_view("yaw:40"), SOFA))


@pytest.fixture(scope="module")
def taught(sofa):
    return learn_view(sofa, view_of(sofa, ""), Vocabulary(LABELS), kind="phase", calibrate=False)


@pytest.fixture
def files(tmp_path, people, sofa):
    write_archive(tmp_path / "people.npz", people)
    write_archive(tmp_path / "sofa.npz", sofa)
    write_archive(tmp_path / "shelf.npz", replace(sofa, camera=TracksCamera("shelf")))
    return tmp_path


def posterior(model, tracks):
    watch = model.watch(Onset(known=True))
    for each in tracks:
        watch.update(each)
    return watch.p


def test_tracks_teach_what_the_camera_would_see_of_3d(people, sofa, taught):
    view = parse_view("yaw:40")
    learned = learn_view(people, view, Vocabulary(LABELS), kind="phase", calibrate=False)
    person = perform(("3",), LABELS, trials=1, seed=8)
    shown = in_px(projected(person, view, SOFA))
    for in_space, seen in zip(person.recordings, shown.recordings, strict=True):
        of_tracks = view_tracks(this_camera(), seen, person.body_parts, sofa.body_parts)
        of_space = view_tracks(view, in_space, person.body_parts, sofa.body_parts)
        np.testing.assert_allclose(posterior(taught, of_tracks), posterior(learned, of_space), atol=1e-3)


def test_learn_says_that_the_model_is_for_the_camera_as_it_stands(run, files):
    model = files / "sofa.model"
    status, out, _ = run("learn", files / "sofa.npz", "--model", "phase", "-o", model)
    assert status == 0 and "phase for camera:sofa, 2 movements from 12 examples of 2 people" in out
    assert "taught from the tracks of sofa: teach it again when the camera moves" in out
    header = read_model(model).header
    assert header.view == "camera:sofa" and parse_view(header.view).is_this_camera


def test_examples_by_people_who_will_be_judged_are_left_out_one_by_one(run, files):
    models = []
    for words in ((), ("--known-people",)):
        run("learn", files / "sofa.npz", "--parameter", "kernels=84", *words, "-o", files / "sofa.model")
        models.append(read_model(files / "sofa.model"))
    # Names stay, so that they can be forgotten.
    assert not np.array_equal(*(model.arrays()["stacker_weights"] for model in models))
    assert [model.header.provenance["subjects"] for model in models] == ["1,2", "1,2"]


@pytest.mark.parametrize(
    ("words", "error"),
    [
        ("sofa.npz --view door", "view door: the recordings are 2-D tracks of one camera; give no view, or camera"),
        ("people.npz --view camera", "view camera: the recordings are positions in 3-D; say from where"),
        ("people.npz", "--view: needed"),
        ("sofa.npz --background people.npz", "--background people.npz: positions in 3-D, but the movements are 2-D"),
        (
            "people.npz --view door --background sofa.npz",
            "sofa.npz: 2-D tracks of one camera, but the movements are po",
        ),
        ("sofa.npz --background shelf.npz", "shelf.npz: tracks of shelf, but the movements are tracks of sofa"),
        ("sofa.npz --parameter facings=12", "facings=12: 2-D tracks cannot be turned"),
    ],
)
def test_what_does_not_fit_together_is_one_line(run, files, monkeypatch, words, error):
    monkeypatch.chdir(files)
    status, _, err = run("learn", *words.split(), "-o", "any.model")
    assert status == 2 and err.count("\n") == 1 and error in err


def test_movements_are_added_from_the_same_camera_only(sofa):
    parameters = {"kernels": 84.0}
    taught = learn_view(sofa, view_of(sofa, ""), Vocabulary(LABELS), parameters=parameters, calibrate=False)
    new = perform(("1", "2"), ("lunging",), trials=3, seed=5)
    seen = in_px(projected(new, parse_view("yaw:40"), SOFA))
    assert add_movements(taught, seen, view_of(seen, "")).model.header.vocabulary.labels == (*LABELS, "lunging")
    shelf = replace(seen, camera=TracksCamera("shelf"))
    with pytest.raises(BadInput, match="recordings of camera:shelf: the model is for camera:sofa"):
        add_movements(taught, shelf, view_of(shelf, ""))
    with pytest.raises(BadInput, match="--view door: the model is for camera:sofa"):
        add_movements(taught, new, parse_view("door"))


def test_an_observer_plays_tracks_and_another_observers_model_is_doubted(run, files, taught):
    write_model(files / "sofa.model", taught)
    sections = (
        f'[observers.{name}]\nsource = "sofa.npz"\nview = "camera"\nmodel = "sofa.model"\n'
        for name in ("sofa", "shelf")
    )
    (files / "room.toml").write_text('scene = "room"\n' + "".join(sections))
    from observer.runtime.preflight import main

    sofa, shelf = map(json.loads, main([str(files / "room.toml")]))
    assert sofa["faults"] == shelf["faults"] == sofa["doubts"] == [] and sofa["taught_from"] == "sofa"
    (doubt,) = shelf["doubts"]
    assert "taught from the tracks of sofa, and this observer is shelf" in doubt


@pytest.mark.parametrize(
    ("section", "fault"),
    [
        ('source = "people.npz"\nview = "camera"', "holds positions in 3-D; name a view"),
        ('source = "sofa.npz"\ntracker = "camshift"', "holds 2-D tracks, which no tracker can film"),
    ],
)
def test_a_source_that_the_view_or_the_tracker_cannot_show_is_a_fault(files, taught, section, fault):
    from observer.runtime.preflight import main

    write_model(files / "sofa.model", taught)
    (files / "room.toml").write_text(f'scene = "room"\n[observers.sofa]\nmodel = "sofa.model"\n{section}\n')
    (report,) = map(json.loads, main([str(files / "room.toml")]))
    assert any(fault in line for line in report["faults"])


@pytest.fixture(scope="module")
def evaluated(people):
    streams = [perform_continuously(person, LABELS, seed=4) for person in ("1", "2")]
    life = [Recording(r.positions[::-1].copy(), r.rate_hz, "", r.subject, "life") for r in streams]
    return MotionArchive(people.body_parts, (*streams, *life))


def test_streams_of_tracks_are_judged_as_those_in_3d(evaluated):
    """Oracle: the evaluation of the same streams in 3-D, seen from the same place."""
    common = {"labels": LABELS, "train_subjects": ("1",), "model": "phase", "calibrated": False}
    view = parse_view("door")
    in_space = judge_streams(evaluated, EvaluationSettings(views=(view,), **common))
    seen = projected(evaluated, view, SOFA)
    of_tracks = judge_streams(seen, EvaluationSettings(views=(view_of(seen, ""),), **common))
    assert in_space["movements"] == 2 and in_space["other_motion"]["minutes"] > 0.1
    assert of_tracks == in_space


@pytest.mark.parametrize("option", ["--turn=90", "--parameter=facings=4"])
def test_what_needs_positions_in_space_is_refused_for_tracks(run, files, option):
    status, _, err = run("evaluate", files / "sofa.npz", "--train-subjects", "1", option)
    assert status == 2 and err.count("\n") == 1 and "needs positions in 3-D" in err


def test_sensors_of_tracks_are_evaluated_together_and_apart_from_3d(run, files, monkeypatch):
    monkeypatch.chdir(files)
    sensors = ("--sensor", "a=sofa.npz", "--sensor", "b=shelf.npz")
    cheap = ("--train-subjects", "1", "--model", "phase", "--uncalibrated", "--jobs", "1")
    status, out, _ = run("evaluate", *sensors, *cheap)
    assert status == 0 and "sofa" not in out
    status, _, err = run("evaluate", *sensors[:3], "b=people.npz", "--train-subjects", "1")
    assert status == 2 and "all sensors must be 2-D tracks, or all positions in 3-D" in err
    status, _, err = run("evaluate", *sensors, "--train-subjects", "1", "--background", "sofa.npz")
    assert status == 2 and "tracks belong to one camera" in err
    assert read_archive(files / "sofa.npz").camera == SOFA


def test_archives_in_3d_become_tracks_as_a_camera_sees_them_and_several_become_one(run, files, people):
    status, out, _ = run("import", "archive", files / "people.npz", "--seen-from", "yaw:40", "-o", files / "hall.npz")
    assert status == 0 and "hall.npz: 12 recordings, 2 movements, 2 people" in out
    hall = read_archive(files / "hall.npz")
    assert hall.camera == TracksCamera("hall")
    seen = projected(people, parse_view("yaw:40"), hall.camera).recordings
    assert all(np.array_equal(one.positions, other.positions) for one, other in zip(hall.recordings, seen, strict=True))
    status, _, err = run("import", "archive", files, "-o", files / "all.npz")
    assert status == 2 and "people.npz: positions in 3-D" in err
    status, _, err = run("import", "archive", files / "hall.npz", "--seen-from", "door", "-o", files / "all.npz")
    assert status == 2 and "2-D tracks of one camera" in err


def test_what_the_only_person_does_beside_the_movements_is_not_named():
    """Four takes of three movements by one person, and six times a gesture that is like one of them, but none."""
    labels, view = ("byebye", "maestro", "stretch"), parse_view("door")
    takes = perform(("1",), labels, trials=4, seed=1)
    life, later = (replace(perform_continuously("1", ("ok",) * 6, seed=n), spans=(), label="") for n in (1, 51))
    archive = replace(takes, recordings=(*takes.recordings, life))
    watch = learn_view(archive, view, Vocabulary(labels)).watch(Onset())
    named = []
    for tracks in view_tracks(view, later, archive.body_parts, archive.body_parts):
        watch.update(tracks)
        named.append(watch.unlearned.sum() < 0.5)
    assert np.mean(named) < 0.1, "where the lesson's life is not left out and watched, half of these frames have a name"
