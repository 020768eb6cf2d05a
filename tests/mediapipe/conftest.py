"""Fixtures of the mediapipe tracker's tests: recorded clips with their truth, tracked once, and a model file."""

import csv
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from mediapipe_stage import follow, unmirrored

from benchmarks.clips.material import CAMERA
from hub.phone.pose_task import pose_task
from observer.motion.archive import MotionArchive
from observer.motion.importers.florence3d import import_folder
from observer.tracking.mediapipe_pose import MediapipeTracker
from observer.tracks import BODY_PARTS, WHOLE_BODY, Tracks
from studies.sensors import with_parts

NAMED_BY = "LABANMESH_POSE_MODEL"


@dataclass(frozen=True, slots=True)
class Clip:
    """truth: (F, 3, 2) px, head_to_hip: (F,) px, both from the joints; tracks: by the palm, then by the wrist. joints:
    (F, 15, 2) px of all joints; whole: (F, 15, 2) px of the parts of WHOLE_BODY that were tracked."""

    name: str
    label: str
    subject: str
    truth: np.ndarray
    head_to_hip: np.ndarray
    palm: list
    wrist: list
    joints: np.ndarray
    whole: np.ndarray


@dataclass(frozen=True, slots=True)
class Florence:
    """camera: (3, 4) metres to pixels of the pictures as they are tracked. archive: all recordings, not these alone."""

    camera: np.ndarray
    archive: MotionArchive
    clips: list


@pytest.fixture(scope="session")
def florence(data, pose_model):
    """The 16 clips with their joints as truth, each tracked by a new tracker."""
    from scipy.io import loadmat

    archive = with_parts(import_folder(data / "florence3d").archive, BODY_PARTS)
    joints = loadmat(str(data / "florence3d/skeletal_data.mat"), simplify_cells=True)["skeletal_data"]
    clips = []
    for row in csv.DictReader((data / "florence3d_videos/labels.csv").read_text().splitlines()):
        number = int(row["video_id"]) - 1
        recording = archive.recordings[number]
        label = row["class"].replace(" ", "_")
        assert (recording.label, recording.subject) == (label, row["subject"])
        raw = joints[number]["original_skeletal_data"]
        hips = raw[:, (9, 12)].mean(axis=1)[[0, 2, 1]].T
        truth = in_picture(np.concatenate([recording.positions.astype(np.float64), hips[:, None]], axis=1))
        all_joints = in_picture(raw.transpose(2, 1, 0)[..., [0, 2, 1]])
        head_to_hip = np.linalg.norm(truth[:, 2] - truth[:, 3], axis=1)
        shown = unmirrored(data / "florence3d_videos" / row["file"])
        assert len(shown) == len(truth)
        whole = follow(MediapipeTracker(pose_model, "palm", WHOLE_BODY), shown, recording.rate_hz)
        palm = [Tracks(t.centres[:3], t.guesses[:3]) for t in whole]
        wrist = follow(MediapipeTracker(pose_model, "wrist"), shown, recording.rate_hz)
        centres = np.array([t.centres for t in whole])
        about = row["file"], label, row["subject"]
        clips.append(Clip(*about, truth[:, :3], head_to_hip, palm, wrist, all_joints, centres))
    return Florence(CAMERA, archive, clips)


def in_picture(metres):
    """(..., 3) metres -> (..., 2) px."""
    points = metres @ CAMERA[:, :3].T
    return points[..., :2] / points[..., 2:]


@pytest.fixture(scope="session")
def pose_model():
    """The model path of `MediapipeTracker`: None where mediapipe carries a model, else LABANMESH_POSE_MODEL."""
    mediapipe = pytest.importorskip("mediapipe")
    if hasattr(mediapipe, "solutions"):
        return None
    return named_model() or pytest.skip(f"mediapipe {mediapipe.__version__} carries no model: name a {NAMED_BY}")


def named_model():
    return os.environ.get(NAMED_BY)


@pytest.fixture(scope="session")
def task_file(pose_model, tmp_path_factory):
    """A .task file such as newer versions need: the named one, or made of the two models in the wheel of 0.10.21."""
    if named_model():
        return Path(named_model())
    import mediapipe

    folder = Path(mediapipe.__file__).parent / "modules"
    file = tmp_path_factory.mktemp("model") / "pose.task"
    places = ("pose_detection/pose_detection.tflite", "pose_landmark/pose_landmark_full.tflite")
    file.write_bytes(pose_task(*((folder / place).read_bytes() for place in places)))
    return file
