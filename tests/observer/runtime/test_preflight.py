"""The preflight check of an observer needs neither a camera nor OpenCV."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from performances import DOOR
from processes import SOON_S

from common.config import read_scene
from common.vocabulary import Vocabulary
from observer.learning.learn import learn_view
from observer.model.model_file import write_model
from observer.motion.archive import MotionArchive
from observer.runtime.preflight import check_observer
from studies.performer import perform

ROOT = Path(__file__).parents[3]


@pytest.fixture
def preflight(place):
    def look(section, head="", model="cam1.model"):
        path = place / "scene.toml"
        path.write_text(f'scene = "dojo"\n{head}[observers.a]\nmodel = "{model}"\n{section}\n')
        return check_observer(read_scene(path, {}), "a")

    return look


def test_a_valid_observer_has_no_findings(preflight):
    result = preflight('source = "motion.npz"')
    assert (result.faults, result.doubts, result.lacks) == ([], [], [])
    assert (result.labels, result.reads) == (["lunging", "byebye"], "positions") and result.rate_hz


@pytest.mark.parametrize(
    ("section", "words"),
    [
        ('source = "motion.npz"\nview = "dor"', "did you mean door?"),
        ('source = "motion.npz"\ntracker = "camshft"', "unknown tracker"),
        ('source = "zenoh:k"\ntracker = "camshift"', "reads pictures"),
        ('source = "gone.npz"', "gone.npz"),
        ('source = "motion.npz"\nrate_hz = 30', "learned at"),
    ],
)
def test_a_fault_has_the_error_of_observe(preflight, section, words):
    (fault,) = preflight(section).faults
    assert words in fault


def test_all_faults_of_an_observer_are_listed(preflight):
    faults = preflight('source = "gone.npz"\nview = "dor"\ntracker = "camshft"').faults
    assert len(faults) == 3 and all(word in "".join(faults) for word in ("dor", "camshft", "gone.npz"))


def test_a_model_for_another_vocabulary_or_view(preflight):
    (fault,) = preflight('source = "motion.npz"', 'vocabulary = ["bowing", "lunging"]\n').faults
    assert "learned for the vocabulary" in fault
    (doubt,) = preflight('source = "motion.npz"\nview = "wheel"').doubts
    assert "labanmesh learn ... --view wheel" in doubt


@pytest.mark.parametrize("labels", [("lunging",), ()])
def test_a_model_that_learned_no_other_motion_is_named(place, preflight, labels):
    motion = perform(("1",), ("ok", "lunging", "byebye"), trials=2)
    background = (
        None
        if not labels
        else MotionArchive(motion.body_parts, tuple(r for r in motion.recordings if r.label in labels))
    )
    words = Vocabulary(("ok", "byebye"))
    learned = learn_view(motion, DOOR, words, kind="stacked", calibrate=False, background=background)
    write_model(place / "stacked.model", learned)
    result = preflight('source = "motion.npz"', model="stacked.model")
    assert result.kind == "stacked"
    assert result.blends_only == (not labels) and not result.doubts


def test_no_camera_is_opened_and_no_standard_input_read(preflight):
    assert preflight('source = "97"').faults == []
    address = 'source = "rtsp://me:secret@127.0.0.1:9/key"'
    assert preflight(address).source == "rtsp://127.0.0.1:9/..."
    assert preflight(address + "\nshow_path = true").source == "rtsp://127.0.0.1:9/key"
    assert "standard input" in preflight('source = "-"').doubts[0]


def test_mediapipe_is_not_started(preflight, monkeypatch):
    monkeypatch.setattr("observer.runtime.preflight.find_spec", lambda name: None)
    assert preflight('source = "97"\ntracker = "mediapipe"').lacks == ["mediapipe"]
    monkeypatch.setattr("observer.runtime.preflight.find_spec", lambda name: name)
    assert preflight('source = "97"\ntracker = "mediapipe"').lacks == []
    (fault,) = preflight('source = "97"\ntracker = "mediapipe"\npose_model = "gone.task"').faults
    assert "gone.task" in fault
    (fault,) = preflight('source = "gone.mp4"\ntracker = "mediapipe"').faults
    assert "gone.mp4: no such file" in fault


def test_a_plain_install_names_the_missing_packages(place):
    """A machine without OpenCV and scipy; it judges recorded motion all the same."""
    (place / "plain.toml").write_text(
        'scene = "dojo"\n[observers.eye]\nsource = "0"\nmodel = "cam1.model"\n'
        '[observers.motion]\nsource = "motion.npz"\nmodel = "cam1.model"\n'
    )
    without = "import runpy, sys; sys.modules.update(cv2=None, scipy=None); "
    run = f"{without}runpy.run_module('observer.runtime.preflight', run_name='__main__')"
    done = subprocess.run(
        [sys.executable, "-c", run, str(place / "plain.toml")], cwd=ROOT, capture_output=True, text=True, timeout=SOON_S
    )
    eye, motion = map(json.loads, done.stdout.splitlines())
    assert (eye["observer"], eye["lacks"], eye["faults"]) == ("eye", ["cv2"], [])
    assert (motion["lacks"], motion["faults"]) == ([], [])
