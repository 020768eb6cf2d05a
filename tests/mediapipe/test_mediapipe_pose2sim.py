"""Four calibrated cameras around one person: wrists tracked in each, triangulated, against the reference."""

import numpy as np
import pytest
from mediapipe_stage import follow, pictures
from observer_stage import pose2sim_markers

from observer.calibration.formats import read_opencv
from observer.calibration.triangulate import triangulate
from observer.tracking.mediapipe_pose import MediapipeTracker

pytest.importorskip("mediapipe")
pytestmark = pytest.mark.slow

EVERY, RATE_HZ = 4, 60.0
GATE_PX = 40.0
"""Of 1080 by 1920: about a palm's width at this distance; the model's wrists differ by that from side to side."""


def wrists(file, pose_model):
    """(F, 2, 2) px of left and right wrist in every fourth picture, NaN where not seen."""
    tracker = MediapipeTracker(pose_model, "wrist")
    tracks = follow(tracker, pictures(file, EVERY), RATE_HZ / EVERY)
    tracker.close()
    return np.array([frame.centres[:2] for frame in tracks])


def test_wrists_triangulated_from_four_videos_are_those_of_the_reference(data, pose_model):
    cameras = read_opencv(data / "pose2sim_single/reference_3d/Pose2Sim_cameras.toml")
    truth = pose2sim_markers(data, "LWrist", "RWrist")[::EVERY]
    videos = [data / f"pose2sim_single/videos/cam0{n}.mp4" for n in (1, 2, 3, 4)]
    seen = np.array([wrists(video, pose_model) for video in videos])
    assert seen.shape[1:] == (*truth.shape[:2], 2)
    plain = np.array([camera.lens.undistorted(pixels) for camera, pixels in zip(cameras, seen, strict=True)])
    matrices = [camera.matrix for camera in cameras]
    points = [[triangulate(matrices, plain[:, f, hand], GATE_PX) for hand in (0, 1)] for f in range(len(truth))]
    off = np.linalg.norm(np.array([[point.point for point in row] for row in points]) - truth, axis=2)
    off = np.where(np.isnan(off), np.inf, off)
    used = np.mean([point.used.sum() for row in points for point in row])
    left, right = np.median(off, axis=0)
    print(
        f"\nmedian {np.median(off) * 100:.1f} cm (left {left * 100:.1f}, right {right * 100:.1f}), 95 %"
        f" {np.percentile(off, 95) * 100:.1f} cm, no point in {np.isinf(off).sum()} of {off.size}; seen"
        f" {np.isfinite(seen[..., 0]).mean():.0%}, {used:.1f} cameras used of 4"
    )
    assert np.median(off) <= 0.06
    assert np.isfinite(off).mean() > 0.9
