"""The camshift tracker on a recorded man who waves, against hands marked by eye in ten pictures."""

import cv2
import numpy as np
import pytest

from observer.tracking.camshift import CamshiftTracker
from observer.tracking.head import have_cascade
from observer.tracks import Frame

RIGHT_HAND = {
    10: (143, 31), 20: (146, 43), 30: (167, 36), 40: (223, 34), 50: (184, 30),
    60: (156, 40), 70: (118, 57), 76: (158, 39), 88: (144, 40), 120: (136, 40),
}  # fmt: skip
"""Frame -> middle of the raised right hand, px."""
HEAD_TO_HIP = 142


def tracked(path):
    video, tracker, found = cv2.VideoCapture(str(path)), CamshiftTracker(), []
    rate = video.get(cv2.CAP_PROP_FPS)
    while (read := video.read())[0]:
        found.append(tracker.update(Frame(int(len(found) * 1e9 / rate), read[1])).centres)
    video.release()
    return np.array(found)


@pytest.mark.slow
@pytest.mark.skipif(not have_cascade(), reason="this OpenCV has no face cascade")
def test_the_raised_hand_is_followed_and_seldom_claimed_elsewhere(data):
    centres = tracked(data / "wave_webcam" / "wave.mp4")
    away = np.array([np.linalg.norm(centres[i, 1] - mark) for i, mark in RIGHT_HAND.items()]) / HEAD_TO_HIP
    assert (away < 0.25).sum() >= 7
    assert (away > 0.5).sum() <= 1
