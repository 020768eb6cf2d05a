"""Pictures of another size than the camera file's: scaled where the shape is the same, else refused with one line."""

import cv2
import numpy as np
import pytest
from observer_stage import rejected

from common.config import read_scene
from observer.geometry.camera_file import CameraModel, write_camera
from observer.geometry.projection import LensDistortion, pinhole_matrix
from observer.geometry.views import View, parse_view, picture_scale, scale_note, size_advice
from observer.prepared_tracks import PreparedTracker
from observer.preview.commands import look
from observer.runtime.preflight import check_observer
from observer.runtime.scene_inputs import open_inputs
from observer.tracks import BODY_PARTS, Frame, Tracks

MATRIX = pinhole_matrix(0.3, 0.1, 3.0, 700, (640, 360))
LENS = LensDistortion(np.array([[700.0, 0, 640], [0, 700, 360], [0, 0, 1]]), np.array([-0.2, 0.05, 0, 0, 0]))
VIEW = View("cam1", MATRIX, LENS, (1280, 720))


class CentreTracker:
    """Finds every part at the same share of the picture."""

    body_parts = BODY_PARTS

    def update(self, frame):
        height, width = frame.content.shape[:2]
        return Tracks(np.tile([0.3 * width, 0.4 * height], (3, 1)))


@pytest.mark.parametrize("size", [(1280, 720), (640, 360), (1920, 1080), (854, 480)])
def test_centres_are_those_of_the_camera_file_whatever_the_size_of_the_pictures(size):
    notes = []
    tracker = PreparedTracker(CentreTracker(), BODY_PARTS, VIEW, notify=notes.append)
    for n in range(2):
        tracks = tracker.update(Frame(n, np.zeros((size[1], size[0], 3), np.uint8)))
    assert len(notes) == (size != (1280, 720))
    expected = LENS.undistorted(np.array([0.3 * 1280, 0.4 * 720]))
    np.testing.assert_allclose(tracks.centres, np.tile(expected, (3, 1)), atol=0.5)
    assert tracker.picture_tracks.centres[0, 0] == pytest.approx(0.3 * size[0])


def test_padding_of_an_encoder_is_no_other_size():
    assert picture_scale(View("cam1", MATRIX, None, (1088, 1920)), (1080, 1920)) == 1.0
    assert scale_note(VIEW, (1280, 720)) == "" and size_advice(parse_view("door"), (10, 20)) == ""


def test_pictures_of_another_shape_are_refused_with_what_to_do():
    tracker = PreparedTracker(CentreTracker(), BODY_PARTS, VIEW)
    with rejected("640x480", "cam1", "1280x720", "size_px = [1280, 720]", "calibrate again"):
        tracker.update(Frame(0, np.zeros((480, 640, 3), np.uint8)))
    assert "another shape" in size_advice(VIEW, (640, 480))


@pytest.fixture
def scene(tmp_path):
    """Two observers of a camera file for 1280x720: one film of half that size, and one of another shape."""
    write_camera(tmp_path / "cam1.toml", CameraModel("cam1", MATRIX, (1280, 720), lens=LENS))
    lines = ['scene = "dojo"']
    for name, (width, height) in {"half": (640, 360), "square": (360, 360)}.items():
        (tmp_path / name).mkdir()
        cv2.imwrite(str(tmp_path / name / "1.png"), np.full((height, width, 3), 128, np.uint8))
        lines += [f'[observers.{name}]\nsource = "{name}"\nview = "cam1.toml"\ntracker = "camshift"']
    (tmp_path / "scene.toml").write_text("\n".join(lines))
    return tmp_path / "scene.toml"


def test_doctor_and_observe_say_so(scene, caplog):
    config = read_scene(scene, {})
    half = open_inputs(config, "half", environment={})
    half.tracker.update(Frame(0, np.full((360, 640, 3), 128, np.uint8)))
    assert "half: pictures of 640x360 px are scaled by 2" in caplog.text
    with rejected("360x360", "another shape"):
        open_inputs(config, "square", environment={})
    assert any("scaled by 2" in doubt for doubt in check_observer(config, "half").doubts)
    assert any("another shape" in fault for fault in check_observer(config, "square").faults)


def test_look_says_so(command, scene):
    output = command(look)("square", "--tracker", "camshift", "--view", "cam1.toml", "--frames", "1")
    assert "-> pictures of 360x360 px, but the camera file of cam1 is for 1280x720" in output
