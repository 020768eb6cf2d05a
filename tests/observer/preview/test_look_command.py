"""`labanmesh look` as a person meets it: what it prints and writes, and says to bad input."""

import re
import threading
from dataclasses import replace

import cv2
import numpy as np
import pytest
import typer

from common.errors import BadInput, LabanmeshError
from observer.camera.base import CameraFault
from observer.camera.files import PictureFolder
from observer.camera.live import LiveCamera
from observer.motion.archive import MotionArchive, Recording
from observer.motion.archive_file import write_archive
from observer.preview import commands, looking
from observer.preview.commands import look
from observer.preview.drawing import SIZE
from observer.preview.looking import LookReport, advice, lines
from observer.tracking.head import have_cascade
from observer.tracking.skin import SkinHistogram
from observer.tracks import BODY_PARTS, State

cascade = pytest.mark.skipif(not have_cascade(), reason="this OpenCV has no face cascade")


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Calls `look` in a folder of its own; gives what it printed."""
    monkeypatch.chdir(tmp_path)
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command("look")(look)
    command = typer.main.get_command(app)

    def call(*words):
        command.main([str(w) for w in words], "labanmesh look", standalone_mode=False)
        return capsys.readouterr().out

    return call


@pytest.fixture
def waving(tmp_path):
    """motion.npz: somebody stands, then waves the right hand."""
    positions = np.tile(np.array([[-0.3, 0.8, -0.1], [0.3, 0.8, -0.1], [0.0, 1.6, 0.0]], np.float32), (24, 1, 1))
    t = np.arange(24)
    positions[:, 1] = np.stack([0.5 + 0.15 * np.sin(t), 1.0 + 0.05 * t.clip(max=10), np.full(24, -0.2)], axis=1)
    path = tmp_path / "motion.npz"
    write_archive(path, MotionArchive(BODY_PARTS, (Recording(positions, 15.0, "wave", "1", "1"),)))
    return path


@cascade
def test_a_rendered_performer_is_seen_and_the_skin_is_saved(run, waving, tmp_path):
    said = run("motion.npz", "-o", "look.png", "--save-skin", "skin.npz")
    assert "motion.npz: 640x480 px, 15 Hz as recorded, 24 pictures seen" in said
    assert "head        seen" in said and "right hand  seen" in said and "skin " in said
    (written,) = PictureFolder.open(tmp_path / "look.png").pictures()
    assert (written.shape[1], written.shape[0]) == SIZE
    assert SkinHistogram.load(tmp_path / "skin.npz").skin.sum() == pytest.approx(1.0)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["look.png", "motion.npz", "skin.npz"]


@cascade
def test_who_turns_the_back_is_told_what_to_do_and_teaches_no_skin(run, waving, tmp_path):
    with pytest.raises(LabanmeshError, match="no skin was learned") as caught:
        run("motion.npz", "--view", "yaw:180", "--save-skin", "skin.npz")
    assert "\n" not in str(caught.value) and (tmp_path / "look.png").exists()
    assert "no face followed: face the camera" in run("motion.npz", "--view", "yaw:180", "--frames", 5)


def test_a_marked_face_is_enough(run, waving):
    recorded = run("motion.npz", "--face", "300,96,40,40")
    assert "its colour in" in recorded


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("gone.mp4", "gone.mp4: no such file"),
        ("gone.npz", "gone.npz"),
        ("motion.npz --tracker camshaft", "did you mean camshift"),
        ("motion.npz --tracker projected", "--tracker = 'projected'"),
        ("motion.npz --view dor", "did you mean door?"),
        ("motion.npz --recording 1", "has recordings 0 to 0"),
        ("motion.npz --face 1,2,3", "X,Y,WIDTH,HEIGHT"),
        ("motion.npz --face 1,2,3,0", "X,Y,WIDTH,HEIGHT"),
        ("motion.npz --skin motion.npz", "a skin histogram"),
        ("motion.npz -o none/look.png", "none/look.png: cannot be written"),
        ("motion.npz -o look.gif", "a name that ends in .png"),
        ("motion.npz --save-skin none/skin.npz", "none/skin.npz: cannot be written"),
        ("ftp://host/stream", "unknown kind of address"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(run, waving, tmp_path, words, said):
    with pytest.raises(BadInput) as caught:
        run(*words.split())
    assert said in str(caught.value) and "\n" not in str(caught.value)
    assert [p.name for p in tmp_path.iterdir()] == ["motion.npz"]


class Webcam:
    """A camera that gives grey pictures with noise."""

    def __init__(self):
        self._rng, self._at_ns = np.random.default_rng(0), 0

    def read(self):
        self._at_ns += 50_000_000
        return self._at_ns, self._rng.integers(80, 120, (48, 64, 3)).astype(np.uint8)

    def close(self):
        pass


def test_of_a_live_camera_the_rate_is_measured(run, monkeypatch):
    monkeypatch.setattr(commands, "_source", lambda *_: LiveCamera("camera 0", Webcam))
    said = run("0", "--frames", 5)
    assert "0: 64x48 px" in said and "Hz measured, 5 pictures seen" in said
    # Stamped 50 ms apart, and those that came while nobody looked are left out.
    assert 0 < float(re.search(r"px, (\S+) Hz", said)[1]) <= 20


def test_a_camera_that_gives_nothing_is_one_line_with_its_reason(run, monkeypatch, tmp_path):
    monkeypatch.setattr(looking, "PATIENCE_S", 0.3)

    def refuse():
        raise CameraFault("cannot be opened")

    monkeypatch.setattr(commands, "_source", lambda *words: LiveCamera("camera 0", refuse, report=words[-1]))
    with pytest.raises(LabanmeshError, match=r"no picture within 0\.3 s: camera 0: cannot be opened"):
        run("0", "--frames", 1)
    assert not list(tmp_path.iterdir())
    assert not [t for t in threading.enumerate() if t.name == "camera camera 0"]


FINE = LookReport(
    "door.mp4", "camshift", (640, 480), 30.0, False, 30, 120.0, 8, 10, 60, 0.02,
    dict.fromkeys(BODY_PARTS, 0.9), dict.fromkeys(BODY_PARTS, State.SEEN),
)  # fmt: skip
BLIND = dict.fromkeys(BODY_PARTS, 0.0)


def changed(**fields):
    return replace(FINE, **fields)


@pytest.mark.parametrize(
    ("account", "said"),
    [
        (FINE, "nothing to do"),
        (changed(brightness=20.0), "too dark"),
        (changed(brightness=240.0), "too bright"),
        (changed(seen=BLIND), "no face followed"),
        (changed(face_px=12), "a face of 12 px is small"),
        (changed(skin=0.4), "much has the colour of skin"),
        (changed(seen={**BLIND, "head": 1.0}), "left hand and right hand not seen"),
        (changed(seen=BLIND, tracker="mediapipe", skin=None), "nobody seen"),
        (changed(complaint="the colours of this room are those of skin"), "camshift says: the colours"),
    ],
)
def test_what_is_found_becomes_one_advice(account, said):
    (only,) = advice(account)
    assert said in only


def test_the_account_names_everything_it_measured():
    text = "\n".join(lines(FINE))
    for found in ("door.mp4", "640x480", "30 Hz as recorded", "120 of 255", "in 8 of 10 pictures, 60 px wide", "2.0 %"):
        assert found in text
    assert text.count("seen in 90 %") == 3
    without = "\n".join(lines(changed(faces_sought=0, skin=None)))
    assert "face" not in without and "skin" not in without


@cascade
@pytest.mark.slow
def test_a_man_who_waves_is_seen(run, data, tmp_path):
    said = run(data / "wave_webcam" / "wave.mp4", "--frames", 40)
    assert "wave.mp4: 420x420 px, 10 Hz as recorded, 40 pictures seen" in said
    assert "right hand  seen" in said and "head        seen" in said
    marked = cv2.imread(str(tmp_path / "look.png"))
    assert marked.shape == (SIZE[1], SIZE[0], 3)
