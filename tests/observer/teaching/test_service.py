"""An observer that is taught while it runs: learning in a process of its own, and the swap of the model."""

import shutil
import threading
from contextlib import contextmanager
from itertools import product
from types import SimpleNamespace

import msgpack
import numpy as np
import pytest

import labanmesh
from common import SECOND_NS
from common.config import MODELS_VARIABLE, read_scene
from common.errors import BadInput
from common.teaching_messages import TeachReply, TeachRequest
from common.wire import decode, encode
from observer.geometry.views import parse_view
from observer.model.model_file import read_model
from observer.motion.archive_file import read_archive
from observer.prepared_tracks import PreparedTracker, Resampler
from observer.runtime.pipeline import Observer
from observer.runtime.scene_inputs import is_untaught
from observer.teaching import model_learner, service
from observer.teaching.service import model_in_force, teachable, why_not
from observer.tracks import BODY_PARTS, Frame, Tracks

REST = np.array([[280.0, 300.0], [360.0, 300.0], [320.0, 100.0]])
LIFTS = {"wave": [0, -200], "reach": [-200, 0]}


PARTS = (*BODY_PARTS, "left_foot")


class Eyes:
    """A tracker of four parts, whose frames are the tracks of three: the foot is behind a sofa, and seldom guessed."""

    body_parts, complaint = PARTS, ""

    def update(self, frame):
        foot = [300.0, 500.0] if frame.captured_ns // (SECOND_NS // 15) % 5 == 0 else [np.nan, np.nan]
        return Tracks(np.vstack([frame.content, foot]))


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "s.toml").write_text('scene = "home"\n[observers.sofa]\nsource = "0"\n')
    return read_scene(tmp_path / "s.toml", {})


class Room:
    """One observer without a model, and somebody in front of it."""

    def __init__(self, observer, learner):
        self.observer, self.learner, self.at_ns = observer, learner, 1_000 * SECOND_NS

    def ask(self, command, **fields):
        return decode(
            TeachReply, self.observer.respond(encode(TeachRequest(command=command, teacher="anna", **fields)))
        )

    def film(self, seconds, lift=(0, 0)):
        """The posterior after so many seconds, in which the right hand goes up or aside and back."""
        for n in range(round(seconds * 15)):
            self.at_ns += SECOND_NS // 15
            hand = np.sin(np.pi * n / (seconds * 15))
            posterior = self.observer.step(Frame(self.at_ns, REST + hand * np.array([[0, 0], lift, [0, 0]])))
        return posterior


@contextmanager
def room_of(scene):
    tracker = PreparedTracker(Eyes(), PARTS)
    inputs = SimpleNamespace(
        tracker=tracker, source=SimpleNamespace(rate_hz=30.0), at_own_rate=False, view=parse_view("door")
    )

    def build(model):
        return Observer(tracker, model, None, Resampler(model.header.rate_hz))

    with teachable(scene, "sofa", inputs, None, build) as observer:
        yield Room(observer, observer._learner)


@pytest.fixture
def room(scene):
    with room_of(scene) as room:
        yield room


def learned(room):
    wait = threading.Event()
    for _ in range(600):
        if (reply := room.ask("status")).state != "learning":
            return reply
        wait.wait(0.05)
    raise AssertionError("it learns for ever")


def test_an_observer_without_a_model_is_taught_and_recognises(room, scene, monkeypatch):
    def run_here(self, labels, references):
        words = ["learn", str(self._takes), "--labels", ",".join(labels), "--body-parts", "auto", "-o", str(self._next)]
        assert labanmesh.main([*words, "--reference", ",".join(references)]) == 0

    # tests/faults/test_teach.py learns in processes.
    monkeypatch.setattr(model_learner.ModelLearner, "_run", run_here)
    assert is_untaught(scene, "sofa")
    assert room.film(2.0) is None and room.observer.vocabulary is None and "labanmesh teach" in room.observer.complaint
    assert room.ask("start", labels=["wave", "reach"]).fault == ""
    for take in (1, 2, 3):
        for label, lift in LIFTS.items():
            assert room.ask("begin", label=label, take=take, person="anna").fault == ""
            room.film(1.0), room.film(1.5, lift), room.film(1.5)
    reply = room.ask("learn", labels=["wave", "reach"], references=["reach"], person="anna")
    assert reply.takes == {"wave": [1, 2, 3], "reach": [1, 2, 3]}
    reply = learned(room)
    assert reply.learned.labels == ["wave", "reach"] and reply.fault == ""
    assert sum(reply.learned.results["wave"].values()) == 3 and reply.learned.references == {"reach": 3}
    assert room.film(0.5) is None, "nothing changes before it is adopted"
    assert room.ask("adopt").fault == ""
    room.film(2.0)
    assert room.observer.vocabulary.labels == ("wave", "reach") and room.observer.complaint == ""
    assert room.film(1.2, LIFTS["reach"]).p.argmax() == 1
    assert room.film(1.0).score.label == "reach"
    assert room.learner.references == {"reach:1", "reach:2", "reach:3"}
    header = read_model(scene.place("sofa.model")).header
    assert header.view == "camera:sofa" and not is_untaught(scene, "sofa")
    assert read_archive(scene.place("sofa.tracks.npz")).body_parts == PARTS and header.body_parts == BODY_PARTS
    # What was done since is remembered, and can become an example.
    reply = room.ask("correct", correction="home-1", label="reach", from_ns=room.at_ns - SECOND_NS, to_ns=room.at_ns)
    assert reply.takes["reach"] == [1, 2, 3, 4] and reply.corrected.seconds > 0.8
    is_forgotten_also_beside_the_scene_file(scene)
    reply = room.ask("forget", person="anna")
    assert (reply.forgotten.takes, reply.forgotten.in_model, reply.takes) == (7, True, {}), "the correction too"
    assert room.ask("forget", person="anna", models=True).forgotten.in_model is False
    assert room.film(0.2) is None and room.observer.vocabulary is None and is_untaught(scene, "sofa")


def is_forgotten_also_beside_the_scene_file(taught):
    """A home that was taught before it had a folder for what is taught: what lies beside the scene file goes too."""
    home = taught.place("home")
    (own := home / "models").mkdir(parents=True)
    (home / "s.toml").write_text('scene = "home"\n[observers.sofa]\nsource = "0"\nclips = { folder = "clips" }\n')
    scene, files = read_scene(home / "s.toml", {MODELS_VARIABLE: str(own)}), ("sofa.model", "sofa.tracks.npz")

    def left_after(*folders, **asked):
        """What an observer forgets of what was taught into these folders: takes, models, clips; and is it in force?"""
        for folder, file in product(folders, files):
            shutil.copy(taught.place(file), folder)
        with room_of(scene) as room:
            report = room.ask("forget", **asked).forgotten
        return report.takes, report.models, report.clips, report.in_model

    (home / "clips").mkdir()
    (home / "clips/20261122T145721Z_sofa_wave_home-1.avi").write_bytes(b"film")
    # The model that the scene file names is in force: it can only be learned anew.
    assert left_after(home, person="anna") == (7, 0, 0, True)
    assert (home / "sofa.model").exists() and not (home / "sofa.tracks.npz").exists()
    assert left_after(home, own, person="anna") == (14, 1, 0, True)
    assert left_after(home, own, everything=True, clips=True) == (14, 2, 1, False)
    assert [path.name for path in home.rglob("*") if path.is_file()] == ["s.toml"] and is_untaught(scene, "sofa")


def test_tracks_are_not_remembered_outside_a_lesson_if_the_scene_says_so(scene, room):
    assert (scene.teaching.remember_minutes, room.observer._recorder.memory_s) == (10, 600)
    room.observer._remembered_s = 0.0
    room.film(30.0)
    assert room.observer._recorder.newest_ns - room.observer._recorder.oldest_ns <= 2 * SECOND_NS
    room.ask("start", labels=["wave", "reach"]), room.film(30.0)
    assert room.observer._recorder.newest_ns - room.observer._recorder.oldest_ns > 25 * SECOND_NS


def test_frames_go_on_while_takes_are_compared(room, monkeypatch):
    room.film(1.0)
    room.ask("start", labels=["wave", "reach"])
    for label, lift in LIFTS.items():
        room.ask("begin", label=label, take=1), room.film(1.0), room.film(1.5, lift), room.film(1.5)
    filmed = []

    def compare(takes, labels):
        film = threading.Thread(target=lambda: filmed.append(room.film(0.2)), daemon=True)
        film.start(), film.join(20)
        return []

    monkeypatch.setattr(service, "doubtful_takes", compare)
    assert room.ask("check", labels=["wave", "reach"]).fault == "" and filmed == [None]


@pytest.mark.parametrize(
    "fields",
    [{"person": "x" * 40_000}, {"label": "x" * 65}, {"labels": ["x" * 65]}, {"correction": "x" * 301}, {"in_s": -1.0}],
)
def test_a_request_without_bounds_is_refused_and_the_next_one_is_answered(room, fields):
    good = {"v": 1, "command": "begin", "teacher": "anna", "label": "wave"}
    reply = decode(TeachReply, room.observer.respond(msgpack.packb(good | fields)))
    assert next(iter(fields)) in reply.fault and room.ask("status").fault == ""


def test_a_failure_to_learn_is_one_line_and_the_old_model_stays(room, scene):
    room.film(1.0)
    room.ask("start", labels=["wave", "reach"])
    room.ask("learn", labels=["wave", "reach"])
    reply = learned(room)
    assert reply.state == "idle" and "sofa.tracks.npz" in reply.fault and "\n" not in reply.fault
    assert not scene.place("sofa.model").exists()
    assert "not understood" in decode(TeachReply, room.observer.respond(b"\xc1")).fault


def test_an_observer_whose_model_cannot_be_read_waits_if_its_takes_lie_beside_it(scene, caplog):
    assert model_in_force(scene, "sofa") is None
    scene.place("sofa.model").write_bytes(b"of another version")
    with pytest.raises(BadInput, match=r"sofa\.model: not a model file"):
        model_in_force(scene, "sofa")
    scene.place("sofa.tracks.npz").touch()
    assert model_in_force(scene, "sofa") is None and "teach it: its takes lie beside it" in caplog.text
    scene.place("s.toml").write_text('scene = "home"\nvocabulary = ["a", "b"]\nobservers.sofa.source = "0"\n')
    with pytest.raises(BadInput, match=r"sofa\.model: not a model file"):
        model_in_force(read_scene(scene.place("s.toml"), {}), "sofa")


def test_an_observer_whose_scene_names_a_model_or_a_vocabulary_needs_its_model(tmp_path):
    lines = {'vocabulary = ["a", "b"]\n': "(a, b); remove that line", 'observers.sofa.model = "x.model"\n': ""}
    for line, reason in lines.items():
        (tmp_path / "s.toml").write_text(f'scene = "home"\n{line}observers.sofa.source = "0"\n')
        scene = read_scene(tmp_path / "s.toml", {})
        assert not is_untaught(scene, "sofa") and reason in why_not(scene, "sofa")
    (tmp_path / "s.toml").write_text(
        'scene = "home"\n[observers.sofa]\nsource = "0"\nmodel = "x.model"\n'
        '[observers.shelf]\nsource = "1"\nmodel = "x.model"\n'
    )
    assert why_not(read_scene(tmp_path / "s.toml", {}), "sofa").startswith("x.model is the model of shelf too")
    (tmp_path / "s.toml").write_text('scene = "home"\nobservers.sofa.source = "0"\n')
    assert why_not(read_scene(tmp_path / "s.toml", {}), "sofa") == ""
    closed = read_scene(tmp_path / "s.toml", {MODELS_VARIABLE: str(tmp_path / "nowhere")})
    assert f"cannot write to {tmp_path / 'nowhere'}" in why_not(closed, "sofa")
