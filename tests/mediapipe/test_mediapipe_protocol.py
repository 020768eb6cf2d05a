"""The tracker with its real model, from the wheel and from a .task file."""

import os
import subprocess
import sys
from itertools import islice

import numpy as np
import pytest
from mediapipe_stage import follow, pictures
from observer_stage import rejected

from observer.tracking.mediapipe_pose import MediapipeTracker
from observer.tracking.pose import NOBODY_S
from observer.tracks import BODY_PARTS, Frame, State

mediapipe = pytest.importorskip("mediapipe")
RATE_HZ = 10.0
EMPTY = np.full((420, 420, 3), 120, np.uint8)
MISSING, SEEN = (State.MISSING,) * 3, (State.SEEN,) * 3


def video(file, count):
    return list(islice(pictures(file), count))


@pytest.fixture
def stand(data):
    """20 pictures of a person who stands in front of shelves."""
    return video(data / "wave_webcam/stand.mp4", 20)


@pytest.fixture(params=["wheel", "task"])
def model_path(request):
    """None for the model in the wheel, and a .task file as newer versions need."""
    path = None if request.param == "wheel" else str(request.getfixturevalue("task_file"))
    if path is None and not hasattr(mediapipe, "solutions"):
        pytest.skip(f"mediapipe {mediapipe.__version__} carries no model")
    return path


@pytest.fixture
def tracker(model_path):
    with_model = MediapipeTracker(model_path)
    yield with_model
    with_model.close()


def test_nobody_is_found_in_empty_and_drawn_pictures(tracker):
    drawn = EMPTY.copy()
    drawn[50:120, 180:240], drawn[200:240, 60:90], drawn[200:240, 330:360] = [(110, 150, 210)] * 3
    noise = np.random.default_rng(0).integers(0, 255, EMPTY.shape, dtype=np.uint8)
    tracks = follow(tracker, [EMPTY, drawn, noise] * int(NOBODY_S * RATE_HZ), RATE_HZ)
    assert {t.states for t in tracks} == {MISSING}
    assert "nobody" in tracker.complaint


def test_the_persons_left_hand_is_on_the_right_of_the_picture(tracker, stand):
    tracks = follow(tracker, stand, RATE_HZ)
    assert tracks[-1].states == SEEN
    left, right, head = tracks[-1].centres
    assert right[0] < head[0] < left[0]
    assert head[1] < left[1]
    assert head[1] < right[1]
    assert tuple(tracker.body_parts) == BODY_PARTS
    assert not tracker.complaint


def test_a_person_who_leaves_is_missing_until_they_return(tracker, stand):
    tracks = follow(tracker, [*stand[:5], *[EMPTY] * 5, *stand[5:15]], RATE_HZ)
    assert [t.states for t in tracks[5:10]] == [MISSING] * 5
    assert tracks[4].states == SEEN == tracks[-1].states


def test_a_covered_hand_is_not_seen_and_the_other_parts_are(tracker, stand):
    left = follow(tracker, stand[:5], RATE_HZ)[-1].centres[0]
    centre_x, centre_y = left.astype(int)
    covered = [picture.copy() for picture in stand[5:]]
    for picture in covered:
        picture[centre_y - 70 : centre_y + 60, centre_x - 45 : centre_x + 60] = 90
    # The model's doubt grows slowly: after 15 pictures it is at the threshold.
    shown = [*stand[:5], *covered, *covered]
    last = [tracker.update(Frame((5 + n) * 10**8, picture)) for n, picture in enumerate(shown)][-1]
    assert last.states[0] is not State.SEEN
    assert last.states[1:] == (State.SEEN, State.SEEN)


def test_hands_below_the_edge_of_the_picture_are_missing(tracker, stand):
    cut = [np.ascontiguousarray(picture[:185]) for picture in stand]
    last = follow(tracker, cut, RATE_HZ)[-1]
    assert State.SEEN not in last.states[:2]
    assert last.states[2] is State.SEEN


def test_two_runs_are_equal(data, pose_model):
    shown = video(data / "wave_webcam/wave.mp4", 40)
    runs = [follow(MediapipeTracker(pose_model), shown, RATE_HZ) for _ in range(2)]
    for first, second in zip(*runs, strict=True):
        np.testing.assert_array_equal(first.centres, second.centres)
    assert np.isfinite([t.centres for t in runs[0]]).mean() > 0.9


def test_wheel_and_task_file_agree(data, task_file):
    if not hasattr(mediapipe, "solutions"):
        pytest.skip(f"mediapipe {mediapipe.__version__} has only one of them")
    shown = video(data / "wave_webcam/wave.mp4", 60)
    centres = [
        np.array([t.centres for t in follow(MediapipeTracker(path), shown, RATE_HZ)]) for path in (None, str(task_file))
    ]
    distance = np.linalg.norm(centres[0] - centres[1], axis=2)
    assert np.nanmedian(distance) < 4  # px, of some 145 from head to hips; only one of them smooths with real times
    assert np.isfinite(distance).mean() > 0.9


def test_the_size_of_the_pictures_may_change(tracker, stand, pose_model):
    halves = [np.ascontiguousarray(picture[::2, ::2]) for picture in stand[10:]]
    changed = follow(tracker, [*stand[:10], *halves], RATE_HZ)
    whole = follow(MediapipeTracker(pose_model), stand, RATE_HZ)
    np.testing.assert_allclose(changed[-1].centres * 2, whole[-1].centres, atol=10)


def test_a_file_without_a_model_is_rejected_with_one_line(tmp_path):
    file = tmp_path / "pose.task"
    for content in (b"", b"no model", bytes(1000)):
        file.write_bytes(content)
        with rejected("pose.task", "a pose landmarker .task file is expected"):
            MediapipeTracker(str(file))


def test_nothing_is_written_to_stderr_even_without_close(model_path):
    program = (
        "import numpy as np; from observer.tracking.mediapipe_pose import MediapipeTracker; from observer.tracks"
        f" import Frame; tracker = MediapipeTracker({model_path!r});"
        " print(tracker.update(Frame(0, np.zeros((48, 64, 3), np.uint8))).states)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert "missing" in done.stdout
    assert done.stderr == ""


def test_stderr_works_again_after_start(pose_model, capfd):
    MediapipeTracker(pose_model).close()
    os.write(2, b"message")
    assert capfd.readouterr().err == "message"
