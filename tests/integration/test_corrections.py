"""Corrections over the mesh: two observers that remember, one whose clock is ahead and one that has just begun."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from mesh_stage import LOOPBACK
from processes import until

from common import SECOND_NS
from common.config import read_scene
from common.teaching_messages import TeachRequest, Unwanted
from common.vocabulary import Vocabulary
from hub.teaching.correcting import Correction, correct
from hub.teaching.forgetting import forget
from hub.teaching.participants import Participants
from hub.teaching.teaching_client import TeachingClient
from observer.geometry.views import parse_view
from observer.motion.archive import MotionArchive, Recording, TracksCamera
from observer.motion.archive_file import read_archive, write_archive
from observer.runtime.prepared_tracker import PreparedTracker
from observer.teaching.service import answer_teachers, teachable
from observer.tracks import BODY_PARTS, Frame, Tracks

REST = np.array([[280.0, 300.0], [360.0, 300.0], [320.0, 100.0]])
WAVED_NS, HOUR_S = 2_000 * SECOND_NS, 3600


class Eyes:
    """A tracker whose frames are the tracks."""

    body_parts, complaint = BODY_PARTS, ""

    def update(self, frame):
        return Tracks(frame.content)


@pytest.fixture
def scene(tmp_path):
    observers = "".join(f'[observers.{name}]\nsource = "0"\n' for name in ("sofa", "shelf", "door"))
    (tmp_path / "s.toml").write_text(f'scene = "home"\n{LOOPBACK}{observers}')
    return read_scene(tmp_path / "s.toml", {})


def taught(scene, name, mesh, begin_s, ahead_s=0):
    """An observer that was taught, and has seen somebody wave at WAVED_NS if it had begun then."""
    path = scene.place(f"{name}.tracks.npz")
    takes = [Recording(np.repeat(REST[None], 20, 0).astype(np.float32), 15, label, "anna", "1") for label in "ab"]
    write_archive(path, MotionArchive(BODY_PARTS, tuple(takes), camera=TracksCamera(name)))
    tracker = PreparedTracker(Eyes(), BODY_PARTS)
    judge = SimpleNamespace(vocabulary=Vocabulary(("a", "b")), step=lambda frame: tracker.update(frame) and None)
    inputs = SimpleNamespace(
        tracker=tracker, source=SimpleNamespace(rate_hz=30.0), at_own_rate=False, view=parse_view("door")
    )
    context = teachable(scene, name, inputs, judge, lambda model: judge)
    observer = context.__enter__()
    for n in range(round(begin_s * 15), 20 * 15):
        hand = -150 * np.sin(np.pi * (n / 15 - 10) / 2) if 10 <= n / 15 <= 12 else 0
        at_ns = WAVED_NS + round((n / 15 - 10 + ahead_s) * SECOND_NS)
        observer.step(Frame(at_ns, REST + np.array([[0, 0], [0, hand], [0, 0]])))
    answer_teachers(mesh.peer("observer"), scene, name, observer)
    return context


def test_a_missed_movement_is_cut_by_each_observer_in_its_own_time_and_forgotten_again(mesh, scene):
    contexts = [
        taught(scene, "sofa", mesh, 0, HOUR_S),
        taught(scene, "shelf", mesh, 0),
        taught(scene, "door", mesh, 15),
    ]
    lines = []
    interface = SimpleNamespace(say=lines.append, now_s=lambda: 0.0, pause=lambda seconds: None)
    ask, names = TeachingClient(mesh.peer(), scene.keys).ask, ["sofa", "shelf", "door"]
    until(lambda: len(ask(TeachRequest(command="status", teacher="t"), names).replies) == len(names))
    participants = Participants("t", interface, ask, names, add=True)
    moment_ns = WAVED_NS + 3 * SECOND_NS
    made = correct(participants, [Correction("missed-1", "a", moment_ns, moment_ns)], {"sofa": HOUR_S}, "ben")
    assert made == {"sofa": 1, "shelf": 1, "door": 0}
    assert re.fullmatch(r"  door: remembers only the last \d s, and this was before", lines[-1])
    for name in ("sofa", "shelf"):
        *_, example = read_archive(scene.place(f"{name}.tracks.npz")).recordings
        assert (example.label, example.subject, example.trial) == ("a", "ben", "2")
        assert 1.8 < len(example.positions) / 15 < 3.2 and np.ptp(example.positions[:, 1, 1]) > 140
    forget(participants, Unwanted(person="ben"))
    assert "sofa: removed 1 take" in lines and "door: had nothing of it on its disk" in lines
    for context in contexts:
        context.__exit__(None, None, None)
