"""Four calibrated cameras around one person: the parts that each sees, and wrists triangulated, with a reference."""

import json
import tomllib

import numpy as np
import pytest
from mediapipe_stage import follow, pictures
from observer_stage import pose2sim_markers

from labanmesh import main
from observer.calibration.calibrated import read_opencv
from observer.geometry.placement import facing_of
from observer.motion.archive_file import read_archive
from observer.recording.triangulation import triangulate_all
from observer.tracking.mediapipe_pose import MediapipeTracker
from observer.tracks import WHOLE_BODY

pytest.importorskip("mediapipe")
pytestmark = pytest.mark.slow

EVERY, RATE_HZ = 4, 60.0
GATE_PX = 40.0
"""Of 1080 by 1920: about a palm's width at this distance; the model's wrists differ by that from side to side."""


MARKERS = {"hand": "Wrist", "elbow": "Elbow", "shoulder": "Shoulder", "hip": "Hip", "knee": "Knee"}
PAIRED = [f"{side}_{part}" for part in MARKERS for side in ("left", "right")]


@pytest.fixture(scope="module")
def cameras(data):
    return read_opencv(data / "pose2sim_single/reference_3d/Pose2Sim_cameras.toml")


@pytest.fixture(scope="module")
def seen(data, pose_model):
    """(4, F, 15, 2) px of the whole body in every fourth picture of each camera, NaN where not seen."""
    return np.array([tracked(data / f"pose2sim_single/videos/cam0{n}.mp4", pose_model) for n in (1, 2, 3, 4)])


def tracked(file, pose_model):
    tracker = MediapipeTracker(pose_model, "wrist", WHOLE_BODY)
    tracks = follow(tracker, pictures(file, EVERY), RATE_HZ / EVERY)
    tracker.close()
    return np.array([frame.centres for frame in tracks])


def test_the_whole_body_is_seen_and_left_and_right_are_those_of_the_person(data, cameras, seen):
    """For one camera in four the model exchanges left and right in three frames of ten."""
    truth = pose2sim_markers(data, *(f"{s}{MARKERS[p]}" for p in MARKERS for s in "LR"))[::EVERY]
    rows = [WHOLE_BODY.index(part) for part in PAIRED]
    right, ends = [], [WHOLE_BODY.index(p) for p in ("left_hand", "right_hand", "head", "left_foot", "right_foot")]
    for camera, pixels in zip(cameras, seen, strict=True):
        places = np.concatenate([truth, np.ones((*truth.shape[:2], 1))], axis=2) @ camera.matrix.T
        there = places[..., :2] / places[..., 2:]
        found = np.array([camera.lens.undistorted(frame) for frame in pixels[:, rows]])
        other = there.reshape(len(there), -1, 2, 2)[:, :, ::-1].reshape(there.shape)
        own, exchanged = (np.nansum(np.linalg.norm(found - each, axis=2), axis=1) for each in (there, other))
        right.append((own < exchanged).mean())
    shares = np.isfinite(seen[:, :, ends, 0]).mean(axis=1)
    print(f"\nleft and right right: {np.round(right, 2)}; hands, head, feet seen:\n{shares.round(2)}")
    assert min(right) >= 0.99
    # Camera 3 sees the back of the man, and his right hand behind it.
    shares[2, 1] = 1.0
    assert shares.min() >= 0.95


def test_wrists_triangulated_from_four_videos_are_those_of_the_reference(data, cameras, seen):
    truth = pose2sim_markers(data, "LWrist", "RWrist")[::EVERY]
    seen = seen[:, :, :2]
    plain = np.array([camera.lens.undistorted(pixels) for camera, pixels in zip(cameras, seen, strict=True)])
    matrices = [camera.matrix for camera in cameras]
    seen_by_all = plain[:, : len(truth)].reshape(len(matrices), -1, 2).swapaxes(0, 1)
    result = triangulate_all(matrices, seen_by_all, GATE_PX)
    off = np.linalg.norm(result.points.reshape(truth.shape) - truth, axis=2)
    off = np.where(np.isnan(off), np.inf, off)
    used = np.mean(result.used.sum(axis=1))
    left, right = np.median(off, axis=0)
    print(
        f"\nmedian {np.median(off) * 100:.1f} cm (left {left * 100:.1f}, right {right * 100:.1f}), 95 %"
        f" {np.percentile(off, 95) * 100:.1f} cm, no point in {np.isinf(off).sum()} of {off.size}; seen"
        f" {np.isfinite(seen[..., 0]).mean():.0%}, {used:.1f} cameras used of 4"
    )
    assert np.median(off) <= 0.06
    assert np.isfinite(off).mean() > 0.9


@pytest.fixture(scope="module")
def scene(data, pose_model, tmp_path_factory):
    """A scene file of the four videos, in a room whose y points up."""
    folder = tmp_path_factory.mktemp("room")
    call("calibrate", "--read", data / "pose2sim_single/calibration/Calib.qca.txt", "--up", "z", "-o", folder)
    lines = ['scene = "beam"']
    for n in (1, 2, 3, 4):
        source = json.dumps(str(data / f"pose2sim_single/videos/cam0{n}.mp4"))
        lines += [f"[observers.cam0{n}]", f"source = {source}", f'view = "cam0{n}.toml"', 'tracker = "mediapipe"']
        lines += ['hand = "wrist"', *([f"pose_model = {json.dumps(pose_model)}"] if pose_model else [])]
    (folder / "scene.toml").write_text("\n".join(lines))
    return folder / "scene.toml"


def call(*words):
    assert main([str(word) for word in words]) == 0


def upright(points):
    """(..., 3) metres in the calibration's room -> in the room whose y points up."""
    return points @ np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]).T


def test_recorded_wrists_are_within_three_centimetres_of_the_reference(data, scene):
    """Row k of the reference is compared with picture k; by its column Time it is the next picture, and 2.5 cm."""
    archive = scene.parent / "beam.npz"
    call("camera", "record", scene, "-o", archive, "--label", "beam", "--subject", "a", "--rate", 60)
    (made,) = read_archive(archive).recordings
    truth = upright(pose2sim_markers(data, "LWrist", "RWrist"))
    off = np.linalg.norm(made.positions[:, :2] - truth, axis=2)
    left, right = np.median(off, axis=0) * 100
    print(f"\nmedian {np.median(off) * 100:.2f} cm (left {left:.2f}, right {right:.2f})")
    assert np.isfinite(off).all() and max(left, right) <= 3.0


def test_place_finds_where_the_person_stands_and_faces(data, scene, capsys):
    call("camera", "place", scene)
    lines = tomllib.loads("[person]" + capsys.readouterr().out.partition("[person]")[2])["person"]
    left, right, head = upright(pose2sim_markers(data, "LShoulder", "RShoulder", "Head")).transpose(1, 0, 2)
    faces = np.median([facing_of(line) for line in right - left])
    place, head = np.array(lines["place"]), np.median(head, axis=0)
    print(f"\nfacing {lines['facing']}, reference {faces:.0f} degrees; place {place}, reference {head.round(2)}")
    assert abs((lines["facing"] - faces + 180) % 360 - 180) <= 15
    assert np.linalg.norm(place - head) < 0.25
