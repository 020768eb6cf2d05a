"""`labanmesh camera look`: output, files and errors."""

import re
import sys
import threading
from dataclasses import replace

import numpy as np
import pytest
from observer_stage import rejected
from processes import within

from common.errors import LabanmeshError
from observer.camera.base import CameraFault
from observer.camera.files import read_picture
from observer.camera.live import LiveCamera
from observer.motion.archive import MotionArchive, Recording
from observer.motion.archive_file import write_archive
from observer.preview import commands, looking
from observer.preview.commands import look, picture_lines
from observer.preview.looking import LookReport, advice, report_lines
from observer.tracking.head import have_cascade
from observer.tracking.skin import SkinHistogram
from observer.tracks import BODY_PARTS, Outline, SeenPeople, State

cascade = pytest.mark.skipif(not have_cascade(), reason="this OpenCV has no face cascade")


@pytest.fixture
def run(command):
    return command(look)


@pytest.fixture
def waving(tmp_path):
    """motion.npz: a person stands, then waves the right hand."""
    positions = np.tile(np.array([[-0.3, 0.8, -0.1], [0.3, 0.8, -0.1], [0.0, 1.6, 0.0]], np.float32), (24, 1, 1))
    t = np.arange(24)
    positions[:, 1] = np.stack([0.5 + 0.15 * np.sin(t), 1.0 + 0.05 * t.clip(max=10), np.full(24, -0.2)], axis=1)
    path = tmp_path / "motion.npz"
    write_archive(path, MotionArchive(BODY_PARTS, (Recording(positions, 15.0, "wave", "1", "1"),)))
    return path


@cascade
def test_a_rendered_performer_is_seen_and_the_skin_is_saved(run, waving, tmp_path):
    output = run("motion.npz", "-o", "look.png", "--save-skin", "skin.npz")
    assert "motion.npz: 640x480 px, 15 Hz as recorded, 24 pictures read" in output
    assert "head        seen" in output and "right hand  seen" in output and "skin " in output
    assert read_picture(tmp_path / "look.png").shape == (480, 640, 3)
    assert SkinHistogram.load(tmp_path / "skin.npz").skin.sum() == pytest.approx(1.0)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["look.png", "motion.npz", "skin.npz"]


@cascade
def test_a_person_seen_from_behind_gives_advice_and_no_skin(run, waving, tmp_path):
    with rejected("no skin was learned", error=LabanmeshError):
        run("motion.npz", "--view", "yaw:180", "--save-skin", "skin.npz")
    assert (tmp_path / "look.png").exists()
    assert "no face tracked: face the camera" in run("motion.npz", "--view", "yaw:180", "--frames", 5)


def test_a_marked_face_is_enough(run, waving):
    assert "its colour in" in run("motion.npz", "--face", "300,96,40,40")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("gone.mp4", "gone.mp4: no such file"),
        ("gone.npz", "gone.npz"),
        ("phone", "phone: sends tracks and no pictures; labanmesh watch SCENE shows what it sees"),
        ("motion.npz --tracker camshaft", "did you mean camshift"),
        ("motion.npz --tracker projected", "--tracker = 'projected'"),
        # The options first, and then whether there is such a camera.
        ("99 --tracker camshaft", "did you mean camshift"),
        ("99 --view dor", "did you mean door"),
        ("motion.npz --view dor", "did you mean door?"),
        ("motion.npz --recording 1", "has recordings 0 to 0"),
        ("motion.npz --face 1,2,3", "X,Y,WIDTH,HEIGHT"),
        ("motion.npz --face 1,2,3,0", "X,Y,WIDTH,HEIGHT"),
        ("motion.npz --skin motion.npz", "a skin histogram"),
        ("motion.npz -o none/look.png", "cannot write none/look.png: its folder does not exist"),
        ("motion.npz -o look.gif", "a name that ends in .png"),
        ("motion.npz --save-skin none/skin.npz", "cannot write none/skin.npz"),
        ("ftp://host/stream", "unknown kind of address"),
    ],
)
def test_bad_input_is_rejected_with_one_line_before_writing(run, waving, tmp_path, arguments, message):
    with rejected(message):
        run(*arguments.split())
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


def test_the_rate_of_a_live_camera_is_measured(run, monkeypatch):
    monkeypatch.setattr(commands, "_source", lambda *_: LiveCamera("camera 0", Webcam))
    output = run("0", "--frames", 5)
    assert "0: 64x48 px" in output and "Hz measured, 5 pictures read" in output
    # Stamped 50 ms apart; pictures that arrived while the tracker was busy are dropped.
    assert 0 < float(re.search(r"px, (\S+) Hz", output)[1]) <= 20


def test_a_camera_without_pictures_is_one_line_with_its_reason(run, monkeypatch, tmp_path):
    monkeypatch.setattr(looking, "CAMERA_RESERVE_S", 0.3)

    def refuse():
        raise CameraFault("cannot be opened")

    monkeypatch.setattr(commands, "_source", lambda *words: LiveCamera("camera 0", refuse, report=words[-1]))
    with rejected("no picture within 0.3 s: camera 0: cannot be opened", error=LabanmeshError):
        run("0", "--frames", 1)
    assert not list(tmp_path.iterdir())
    assert not [t for t in threading.enumerate() if t.name == "camera camera 0"]


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux shows a webcam as a file")
@pytest.mark.parametrize("source", ["93", "/dev/video93"])
def test_a_missing_webcam_is_reported_at_once(run, tmp_path, source):
    with within(2.0), rejected(f"camera {source}: there is no /dev/video93. Plug a camera in"):
        run(source)
    assert not list(tmp_path.iterdir())


FINE = LookReport(
    "door.mp4", "camshift", (640, 480), 30.0, False, 30, 120.0, 8, 10, 60, 0.02,
    dict.fromkeys(BODY_PARTS, 0.9), dict.fromkeys(BODY_PARTS, State.SEEN),
)  # fmt: skip
BLIND = dict.fromkeys(BODY_PARTS, 0.0)


def changed(**fields):
    return replace(FINE, **fields)


@pytest.mark.parametrize(
    ("report", "line"),
    [
        (FINE, "nothing to do"),
        (changed(brightness=20.0), "too dark"),
        (changed(brightness=240.0), "too bright"),
        (changed(seen_share=BLIND), "no face tracked"),
        (changed(face_px=12), "a face of 12 px is small"),
        (changed(skin=0.4), "much of the picture has the colour of skin"),
        (changed(seen_share={**BLIND, "head": 1.0}), "left hand and right hand not seen"),
        (changed(seen_share=BLIND, tracker="mediapipe", skin=None), "nobody seen"),
        (changed(complaint="the colours of this room are those of skin"), "camshift reports: the colours"),
    ],
)
def test_each_problem_has_one_advice(report, line):
    (only,) = advice(report)
    assert line in only


def test_the_report_contains_every_measurement():
    text = "\n".join(report_lines(FINE))
    for part in ("door.mp4", "640x480", "30 Hz as recorded", "120 of 255", "in 8 of 10 pictures, 60 px wide", "2.0 %"):
        assert part in text
    assert text.count("seen in 90 %") == 3
    assert "1 picture read" in next(report_lines(changed(pictures=1)))
    without = "\n".join(report_lines(changed(faces_searched=0, skin=None)))
    assert "face" not in without and "skin" not in without


def test_the_report_says_how_many_people_there_are_and_who_is_followed():
    one, other = Outline(100, 50, 200, 400), Outline(400, 60, 460, 300)
    for people, line in (
        (SeenPeople(one, (other,)), "2 seen; followed: the one at 150, 225 px, 350 px tall"),
        (SeenPeople(None, (other,)), "1 seen, nobody followed"),
    ):
        assert any(line in each for each in report_lines(changed(people=people)))
    assert not any("people" in each for each in report_lines(FINE))


@pytest.mark.parametrize(("exact", "red"), [(True, "2;255;0;0"), (False, "5;196")])
def test_a_picture_in_the_terminal_keeps_its_shape_and_colours(exact, red):
    picture = np.zeros((120, 160, 3), np.uint8)
    picture[:60, :, 2] = 255
    lines = picture_lines(picture, 40, 100, exact=exact)
    assert len(lines) == 15 and all(len(re.findall("▀", line)) == 40 for line in lines)
    assert lines[0].startswith(f"\x1b[38;{red};48;{red}m") and red not in lines[-1] and lines[0].endswith("\x1b[0m")
    assert len(picture_lines(picture, 200, 9)) == 9
