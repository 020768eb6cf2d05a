"""The tracker `onnx`, with models that the tests write themselves."""

import importlib.util

import cv2
import numpy as np
import onnx_stage
import pytest
from observer_stage import rejected

from observer.tracking import onnx_pose
from observer.tracking.onnx_pose import OnnxPose, OnnxTracker, as_landmarks
from observer.tracks import Frame, State

WITH_RUNTIME = importlib.util.find_spec("onnxruntime") is not None
ENGINES = ["opencv", pytest.param("onnxruntime", marks=pytest.mark.skipif(not WITH_RUNTIME, reason="not installed"))]
SPOTS = {0: (0.25, 0.2), 1: (0.7, 0.35), 2: (0.5, 0.8)}
"""Shares of width and height, by colour: red, green, blue."""


@pytest.fixture(params=ENGINES)
def engine(request, monkeypatch):
    monkeypatch.setattr(onnx_pose, "_with_onnxruntime", lambda: request.param == "onnxruntime")


@pytest.fixture
def write(tmp_path):
    def written(content):
        path = tmp_path / "pose.onnx"
        path.write_bytes(content)
        return str(path)

    return written


def room(width=320, height=240):
    """(H, W, 3) RGB: black, with a square of each colour."""
    picture = np.zeros((height, width, 3), np.uint8)
    for colour, (u, v) in SPOTS.items():
        x, y = round(u * width), round(v * height)
        picture[y - 6 : y + 7, x - 6 : x + 7, colour] = 255
    return picture


@pytest.mark.parametrize("layout", ["simcc", "movenet", "yolo"])
@pytest.mark.parametrize("size", [(320, 240), (150, 330)], ids=["wide", "tall"])
def test_keypoints_lie_where_the_picture_has_them(engine, write, layout, size):
    landmarks = OnnxPose(write(getattr(onnx_stage, layout)())).landmarks(room(*size), 1)
    assert landmarks.shape == (33, 3)
    off = np.abs(landmarks[[0, 11, 12, 23, 28], :2] - [SPOTS[k % 3] for k in (0, 5, 6, 11, 16)]) * size
    assert off.max() < max(size) / 15
    assert (landmarks[:, 2] > 0.5).all()


def test_movenet_may_want_numbers_with_a_point(engine, write):
    model = OnnxPose(write(onnx_stage.movenet(kind=onnx_stage.FLOAT)))
    assert model.landmarks(room(), 1)[0, :2] == pytest.approx(SPOTS[0], abs=0.06)


@pytest.mark.parametrize("layout", ["simcc", "yolo"])
def test_a_picture_without_a_person_has_no_landmarks(engine, write, layout):
    content = onnx_stage.simcc() if layout == "simcc" else onnx_stage.yolo(confidence=0.1)
    assert OnnxPose(write(content)).landmarks(np.zeros((240, 320, 3), np.uint8), 1) is None


def test_coco_becomes_blazepose_with_the_palm_beyond_the_wrist():
    keypoints = np.zeros((17, 3))
    keypoints[:, 2] = np.linspace(0, 1, 17)
    keypoints[7, :2], keypoints[9, :2] = (0.5, 0.5), (0.6, 0.5)
    keypoints[15, :2] = 0.3, 0.9
    landmarks = as_landmarks(keypoints)
    assert landmarks[[17, 19], 0] == pytest.approx(0.63)
    assert landmarks[[15, 17], 2] == pytest.approx(keypoints[9, 2])
    assert landmarks[[27, 31], :2].tolist() == [[0.3, 0.9]] * 2
    assert landmarks[16, 2] == keypoints[10, 2] and landmarks[23, 2] == keypoints[11, 2]


def test_the_tracker_gives_px_of_bgr_pictures(write):
    tracker = OnnxTracker(write(onnx_stage.yolo()), "wrist", ("right_hand", "head", "left_foot"))
    tracks = tracker.update(Frame(0, cv2.cvtColor(room(), cv2.COLOR_RGB2BGR)))
    assert tracks.states == (State.SEEN,) * 3
    # Keypoints 10 and 15 are green and red; the ears, 3 and 4, red and green.
    middle = np.mean([SPOTS[0], SPOTS[1]], axis=0)
    np.testing.assert_allclose(tracks.centres / (320, 240), [SPOTS[1], middle, SPOTS[0]], atol=0.05)
    tracker.close()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "not an ONNX file"),
        (b"no model", "not an ONNX file"),
        (bytes(100), "not an ONNX file"),
        (onnx_stage.simcc()[:200], "not an ONNX file"),
        (onnx_stage.classifier(), "1x3x32x32 to 1x3x1x1, which gives 1x3x1x1: not a layout of keypoints"),
        (onnx_stage.unknown(), "pip install onnxruntime"),
    ],
)
def test_a_file_that_is_no_pose_model_is_one_line(write, content, words, monkeypatch, capfd):
    monkeypatch.setattr(onnx_pose, "_with_onnxruntime", lambda: False)
    with rejected("pose.onnx", words):
        OnnxPose(write(content))
    assert capfd.readouterr().err == ""


def test_a_missing_file_and_a_missing_setting_are_one_line():
    with rejected("gone.onnx", "no such file"):
        OnnxPose("gone.onnx")
    for path in ("", "pose.task"):
        with rejected('pose_model = "FILE.onnx"', "look: --pose-model"):
            OnnxTracker(path)
