"""The tracker without its model: reading of landmarks, and errors. Runs without mediapipe."""

import importlib
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from observer_stage import rejected

from common.errors import BadInput, LabanmeshError
from observer.tracking import mediapipe_pose, pose
from observer.tracking.mediapipe_pose import MediapipeTracker, TaskPose, open_people
from observer.tracking.pose import LANDMARKS, NOBODY_S, SEEN, UNSURE, PoseTracker, landmarks_of
from observer.tracks import BODY_PARTS, WHOLE_BODY, Frame, State

PICTURE = np.zeros((48, 64, 3), np.uint8)
PARTS = {"left_hand": [15, 17, 19], "right_hand": [16, 18, 20], "head": [7, 8]}


def person(visibility=1.0):
    """All landmarks at the middle of the picture, except those that are read."""
    landmarks = np.full((LANDMARKS, 3), 0.5)
    landmarks[:, 2] = visibility
    landmarks[[15, 17, 19], :2] = (0.70, 0.50), (0.80, 0.60), (0.75, 0.70)
    landmarks[[16, 18, 20], :2] = (0.30, 0.50), (0.20, 0.60), (0.25, 0.70)
    landmarks[[7, 8], :2] = (0.60, 0.20), (0.40, 0.10)
    return landmarks


def read_pose(landmarks, size_px, hand="palm", parts=BODY_PARTS):
    return pose.read_pose(landmarks, size_px, [landmarks_of(part, hand) for part in parts])


def test_hands_are_the_middle_of_the_palm_and_the_head_the_middle_between_the_ears():
    tracks = read_pose(person(), (200, 100))
    np.testing.assert_allclose(tracks.centres, [(150, 60), (50, 60), (100, 15)])
    assert tracks.states == (State.SEEN,) * 3
    np.testing.assert_allclose(read_pose(person(), (200, 100), "wrist").centres, [(140, 50), (60, 50), (100, 15)])


def test_the_whole_body_is_read_on_the_persons_own_sides():
    landmarks = np.tile(np.arange(LANDMARKS)[:, None] / 100, 3)
    landmarks[:, 2] = 1.0
    centres = dict(zip(WHOLE_BODY, read_pose(landmarks, (100, 100), parts=WHOLE_BODY).centres[:, 0], strict=True))
    for part, row in {"elbow": 13, "shoulder": 11, "hip": 23, "knee": 25, "foot": 29}.items():
        assert (centres[f"left_{part}"], centres[f"right_{part}"]) == pytest.approx((row, row + 1))
    assert (centres["neck"], centres["pelvis"]) == pytest.approx((11.5, 23.5))
    with rejected("body part 'left_ear': pose models find left_hand, right_hand, head, left_elbow"):
        landmarks_of("left_ear")


@pytest.mark.parametrize(("part", "rows"), PARTS.items())
@pytest.mark.parametrize(
    ("visibility", "state"),
    [(SEEN, State.SEEN), (SEEN - 0.01, State.UNSURE), (UNSURE, State.UNSURE), (UNSURE - 0.01, State.MISSING)],
)
def test_each_part_is_seen_unsure_or_missing_by_its_own_visibility(part, rows, visibility, state):
    landmarks = person()
    landmarks[rows, 2] = visibility + 1e-9
    states = read_pose(landmarks, (200, 100)).states
    assert states == tuple(state if name == part else State.SEEN for name in BODY_PARTS)


def test_a_hidden_part_is_guessed_where_the_model_puts_it():
    landmarks = person()
    landmarks[PARTS["right_hand"], 2] = 0.3
    tracks = read_pose(landmarks, (200, 100))
    assert np.isnan(tracks.centres[1]).all()
    np.testing.assert_allclose(tracks.guesses, [(np.nan, np.nan), (50, 60), (np.nan, np.nan)])


@pytest.mark.parametrize("away", [(0.9, 0.0), (-0.9, 0.0), (0.0, 0.9), (0.0, -0.9)])
def test_a_part_outside_the_picture_is_missing_however_sure_the_model_is(away):
    landmarks = person()
    landmarks[PARTS["left_hand"], :2] += away
    assert read_pose(landmarks, (200, 100)).states == (State.MISSING, State.SEEN, State.SEEN)


@given(arrays(np.float64, (LANDMARKS, 3), elements=st.floats(-1, 2)), st.integers(1, 4000), st.integers(1, 4000))
def test_seen_and_guessed_parts_lie_in_the_picture_and_are_disjoint(landmarks, width, height):
    tracks = read_pose(landmarks, (width, height))
    for rows in (tracks.centres, tracks.guesses):
        known = rows[~np.isnan(rows).any(axis=1)]
        assert ((known >= 0) & (known <= (width, height))).all()
    assert not (np.isfinite(tracks.centres) & np.isfinite(tracks.guesses)).any()


class FakeModel:
    """A pose model that returns `result` and records its arguments."""

    def __init__(self, result):
        self.result, self.calls, self.closed = result, [], 0

    def landmarks(self, rgb, ms):
        self.calls.append((rgb, ms))
        return self.result

    def close(self):
        self.closed += 1


def tracker_with(result):
    model = FakeModel(result)
    return PoseTracker(model, "mediapipe"), model


def test_the_model_gets_rgb_and_increasing_times():
    tracker, model = tracker_with(person())
    red = PICTURE.copy()
    red[..., 2] = 200
    for at_ns in (10**18, 10**18, 10**18 + 40_000_000, 10**18 - 10**9, 10**18 + 80_000_000):
        tracker.update(Frame(at_ns, red))
    assert [ms for _, ms in model.calls] == [1, 2, 41, 42, 81]
    assert (model.calls[0][0] == (200, 0, 0)).all()
    assert model.calls[0][0].flags["C_CONTIGUOUS"]


def test_centres_are_in_pixels_of_the_picture():
    tracker, _ = tracker_with(person())
    np.testing.assert_allclose(tracker.update(Frame(0, PICTURE)).centres, [(48, 28.8), (16, 28.8), (32, 7.2)])


def test_a_complaint_when_nobody_is_found_for_a_while():
    tracker, model = tracker_with(None)
    assert tracker.update(Frame(0, PICTURE)).states == (State.MISSING,) * 3
    assert not tracker.complaint
    tracker.update(Frame(round(NOBODY_S * 1e9) + 10**8, PICTURE))
    assert "nobody" in tracker.complaint
    assert "camshift" in tracker.complaint
    model.result = person()
    tracker.update(Frame(round(NOBODY_S * 1e9) + 2 * 10**8, PICTURE))
    assert not tracker.complaint


def test_the_model_is_closed_once():
    tracker, model = tracker_with(None)
    tracker.close()
    tracker.close()
    assert model.closed == 1


@pytest.mark.parametrize(
    "content", [PICTURE[..., 0], PICTURE.astype(np.float32), PICTURE[..., :2], np.zeros((0, 64, 3), np.uint8)]
)
def test_a_wrong_shape_or_type_is_rejected_with_one_line(content):
    tracker, _ = tracker_with(person())
    with rejected("(H, W, 3) of uint8"):
        tracker.update(Frame(0, content))


def test_an_unknown_hand_is_rejected_before_loading(monkeypatch):
    monkeypatch.setattr(mediapipe_pose, "open_people", lambda path, smooth: pytest.fail("loaded"))
    with rejected("palm, wrist"):
        MediapipeTracker(hand="thumb")


def test_without_mediapipe_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "mediapipe", None)
    with rejected("pip install 'labanmesh[mediapipe]'"):
        open_people(None)


def test_a_mediapipe_without_model_asks_for_one(monkeypatch):
    newer = ModuleType("mediapipe")
    newer.__version__ = "1.2.2"
    monkeypatch.setitem(sys.modules, "mediapipe", newer)
    for path, message in ((None, "mediapipe 1.2.2 carries no pose model"), ("nowhere.task", "no such file")):
        with rejected(message):
            open_people(path)


def test_a_missing_system_library_is_named(monkeypatch):
    def missing(name):
        raise ImportError("libGL.so.1: cannot open shared object file: No such file or directory")

    monkeypatch.setattr(importlib, "import_module", missing)
    with rejected("libGL.so.1", error=LabanmeshError):
        open_people(None)


def fake_tasks(fault):
    """mediapipe.tasks whose landmarker raises `fault` on creation."""

    def create(options):
        raise fault

    return SimpleNamespace(
        BaseOptions=lambda **keys: None,
        PoseLandmarkerOptions=lambda **keys: None,
        RunningMode=SimpleNamespace(VIDEO=1),
        PoseLandmarker=SimpleNamespace(create_from_options=create),
    )


@pytest.mark.parametrize(
    ("fault", "kind", "message"),
    [
        (RuntimeError("Unable to open zip archive."), BadInput, "Unable to open zip archive; a pose landmarker .task"),
        (FileNotFoundError("no\nmetadata"), BadInput, "no metadata"),
        (OSError("libEGL.so.1: cannot open"), LabanmeshError, "libEGL.so.1"),
    ],
)
def test_errors_of_mediapipe_tasks_become_one_line(monkeypatch, tmp_path, fault, kind, message):
    monkeypatch.setattr(importlib, "import_module", lambda name: fake_tasks(fault))
    file = tmp_path / "some.task"
    file.write_bytes(b"x")
    with rejected(message, error=kind):
        TaskPose(str(file))
