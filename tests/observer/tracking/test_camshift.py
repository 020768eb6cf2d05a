"""The camshift tracker on drawn scenes with exact truth, its advice, and a recorded person who waves."""

import cv2
import numpy as np
import pytest
from observer_stage import rejected

from observer.camera.files import Video
from observer.tracking import camshift
from observer.tracking.camshift import CamshiftTracker, TrackingAdvice, explain_loss
from observer.tracking.head import have_cascade
from observer.tracking.skin import SkinHistogram
from observer.tracks import Frame, State

SKIN = (105, 140, 200)
SIZE = (240, 320)
HEAD = (160, 70)
REGION = (140, 50, 40, 40)
RATE = 30.0
cascade = pytest.mark.skipif(not have_cascade(), reason="this OpenCV has no face cascade")


@pytest.fixture
def discs(monkeypatch):
    """Drawn discs have no face: the tracker starts from the marked region."""
    monkeypatch.setattr(camshift, "have_cascade", lambda: False)


def background(kind, rng):
    if kind == "cluttered":
        picture = np.full((*SIZE, 3), 90, np.uint8)
        for _ in range(60):
            x, y = (int(n) for n in rng.integers(0, 300, 2))
            colour = [(160, 90, 40), (60, 130, 60), (120, 120, 120)][int(rng.integers(3))]
            cv2.rectangle(picture, (x, y), (x + 30, y + 20), colour, -1)
        return picture
    picture = np.full((*SIZE, 3), (120, 110, 60), np.uint8)
    if kind == "skin-toned":
        picture[120:, :] = (130, 165, 228)
    return picture


def scene(left, right, kind="plain", light=lambda i: 1.0, frames=90):
    """Pictures; left and right: functions frame -> (u, v) or None where the hand is not there."""
    rng = np.random.default_rng(7)
    behind = background(kind, rng)
    # Drawn anew for each picture it takes longer than the tracker.
    noise = rng.normal(0, 4, (7, *behind.shape)).astype(np.float32)
    for i in range(frames):
        picture = behind.copy()
        cv2.circle(picture, HEAD, 20, SKIN, -1)
        for hand in (right(i), left(i)):
            if hand is not None:
                cv2.circle(picture, (round(hand[0]), round(hand[1])), 11, SKIN, -1)
        noisy = picture * np.float32(light(i)) + noise[i % len(noise)]
        yield np.clip(noisy, 0, 255).astype(np.uint8)


def track(pictures, tracker=None, rate_hz=RATE):
    tracker = tracker or CamshiftTracker(face_region=REGION)
    centres, states = [], []
    for i, picture in enumerate(pictures):
        tracks = tracker.update(Frame(int(i * 1e9 / rate_hz), picture))
        centres.append(tracks.centres)
        states.append(tracks.states)
    return np.array(centres), states


def wave(side, low=150):
    return lambda i: (160 + side * (75 + 25 * np.sin(i / 5)), low + 20 * np.cos(i / 5))


def errors(centres, truth):
    return np.array([np.linalg.norm(c - t) for c, t in zip(centres, map(truth, range(len(centres))), strict=True)])


@pytest.mark.parametrize("kind", ["plain", "cluttered", "skin-toned"])
@pytest.mark.usefixtures("discs")
def test_two_waving_hands_are_tracked_as_left_and_right(kind):
    left, right = wave(1), wave(-1)
    centres, _ = track(scene(left, right, kind))
    for row, truth in ((0, left), (1, right)):
        distance = errors(centres[:, row], truth)
        assert np.isfinite(distance[15:]).mean() > 0.8
        assert (distance[np.isfinite(distance)] < 16).mean() > 0.95
    assert np.nanmax(np.linalg.norm(centres[:, 2] - HEAD, axis=1)) < 10


@pytest.mark.usefixtures("discs")
def test_hands_that_cross_keep_their_names():
    def left(i):
        return (160 + 80 * np.cos(max(i - 20, 0) * np.pi / 50), 150 + 8 * np.sin(i / 3))

    def right(i):
        return (160 - 80 * np.cos(max(i - 20, 0) * np.pi / 50), 180 + 8 * np.sin(i / 3))

    centres, _ = track(scene(left, right, frames=70))
    for row, truth in ((0, left), (1, right)):
        distance = errors(centres[:, row], truth)[55:]
        assert np.isfinite(distance).mean() > 0.7
        assert np.nanmax(distance) < 16


@pytest.mark.usefixtures("discs")
def test_a_hand_in_front_of_the_face_is_not_seen_and_is_found_again():
    def right(i):
        return (
            wave(-1, 72)(i) if i < 30 else (max(85, 160 - 4 * abs(i - 50)), 72 + (20 * np.sin(i / 4) if i > 66 else 0))
        )

    centres, states = track(scene(lambda i: None, right, frames=110))
    assert all(state[1] is not State.SEEN for state in states[49:52])
    assert np.isnan(centres[49:52, 1]).all()
    distance = errors(centres[:, 1], right)[80:]
    assert np.isfinite(distance).mean() > 0.7
    assert np.nanmax(distance) < 16


@pytest.mark.usefixtures("discs")
def test_a_hand_that_leaves_is_missing_until_it_returns():
    def left(i):
        return None if 40 <= i < 80 else wave(1)(i)

    centres, states = track(scene(left, wave(-1), frames=110))
    assert all(state[0] is not State.SEEN for state in states[43:80])
    assert all(state[0] is State.MISSING for state in states[66:80])
    assert (errors(centres[:, 0], wave(1))[95:] < 16).mean() > 0.8


@pytest.mark.usefixtures("discs")
def test_slow_light_does_not_lose_the_hands():
    centres, _ = track(scene(wave(1), wave(-1), light=lambda i: 1.0 - 0.4 * i / 150, frames=150))
    assert (errors(centres[:, 0], wave(1))[100:] < 16).mean() > 0.8


@pytest.mark.usefixtures("discs")
def test_centres_are_in_pixels_of_a_large_picture():
    large = (cv2.resize(p, None, fx=3, fy=3) for p in scene(wave(1), wave(-1), frames=40))
    centres, _ = track(large, CamshiftTracker(face_region=(420, 150, 120, 120)))
    assert np.nanmedian(errors(centres[20:, 1], lambda i: np.array(wave(-1)(i + 20)) * 3)) < 25


@pytest.mark.parametrize(
    "picture", [np.zeros((40, 40), np.uint8), np.zeros((40, 40, 3)), np.zeros((0, 9, 3), np.uint8)]
)
@pytest.mark.usefixtures("discs")
def test_a_wrong_shape_or_type_is_rejected(picture):
    with rejected("(H, W, 3) of uint8"):
        CamshiftTracker(face_region=REGION).update(Frame(0, picture))


@pytest.mark.usefixtures("discs")
def test_without_cascade_and_region_the_error_names_the_way_out():
    with rejected("no face cascade; mark a region"):
        CamshiftTracker()


@pytest.mark.usefixtures("discs")
def test_a_saved_histogram_is_read_back(tmp_path):
    tracker = CamshiftTracker(face_region=REGION)
    track(scene(wave(1), wave(-1), frames=3), tracker)
    assert tracker.skin is not None
    tracker.skin.save(tmp_path / "skin.npz")
    again = SkinHistogram.load(tmp_path / "skin.npz")
    assert np.array_equal(again.skin, tracker.skin.skin)
    for content in (b"no", b"PK\x03\x04 a truncated zip file", b""):
        (tmp_path / "bad.npz").write_bytes(content)
        with rejected("a skin histogram of two arrays"):
            SkinHistogram.load(tmp_path / "bad.npz")


def test_back_projection_ignores_dark_pale_and_overexposed_pixels():
    picture = next(iter(scene(wave(1), wave(-1))))
    skin = SkinHistogram.learn(picture, REGION)
    assert skin is not None
    colours = np.array([[SKIN, (5, 5, 9), (200, 200, 201), (254, 254, 255), (160, 90, 40)]], np.uint8)
    back = skin.back_project(colours)[0]
    assert back[0] > 150
    assert (back[1:] == 0).all()


@pytest.mark.parametrize(
    ("arguments", "begins"),
    [
        ((0.0, 100.0, 0.0, 40.0), ""),
        ((0.0, 100.0, 0.0, None), ""),
        ((4.9, 10.0, 0.5, None), ""),
        ((5.0, 23.0, 0.5, None), "no face found for 5 s: the picture is dark (mean 23 of 255)"),
        ((5.0, 100.0, 0.4, 40.0), "no face found for 5 s: skin colour covers 40% of the picture"),
        ((5.0, 100.0, 0.0, None), "no face found for 5 s: face the camera"),
        ((0.0, 100.0, 0.0, 14.0), "the face is only 14 px wide"),
    ],
)
def test_the_advice_names_the_cause_and_an_alternative(arguments, begins):
    advice = explain_loss(*arguments)
    assert advice.startswith(begins)
    assert bool(advice) is bool(begins)
    assert not begins or 'tracker = "mediapipe"' in advice


def test_an_advice_stands_until_a_face_is_found():
    advice, dark = TrackingAdvice(), np.zeros((48, 64, 3), np.uint8)
    lines = []
    for _ in range(90):
        advice.update(False, None, 0.0, dark, 0.1)
        lines.append(advice.complaint)
    assert lines[48] == ""
    assert set(lines[51:]) == {lines[-1]}
    assert "dark" in lines[-1]
    advice.update(True, 40.0, 0.0, dark, 0.1)
    assert advice.complaint == ""


@pytest.mark.usefixtures("discs")
def test_sides_follow_the_direction_that_the_person_faces():
    front, behind, side = (
        track(scene(wave(1), wave(-1), frames=50), CamshiftTracker(face_region=REGION, facing=facing))
        for facing in (1.0, -1.0, 0.2)
    )
    # From behind, the hand on the picture's left is the left hand.
    assert np.array_equal(front[0][20:, [1, 0]], behind[0][20:, :2], equal_nan=True)
    assert np.nanmax(behind[0][20:, 0, 0]) < HEAD[0]
    # From the side the hands are unsure and the head is seen.
    centres, states = side
    assert np.isnan(centres[:, :2]).all() and np.isfinite(centres[-1, 2]).all()
    assert all(state[0] is state[1] is State.UNSURE for state in states[30:40])


@cascade
def test_an_empty_dark_room_is_complained_of():
    tracker = CamshiftTracker()
    for n in range(8):
        tracker.update(Frame(n * 1_000_000_000, np.full((120, 160, 3), 12, np.uint8)))
    assert "dark" in tracker.complaint


RIGHT_HAND = {
    10: (143, 31), 20: (146, 43), 30: (167, 36), 40: (223, 34), 50: (184, 30),
    60: (156, 40), 70: (118, 57), 76: (158, 39), 88: (144, 40), 120: (136, 40),
}  # fmt: skip
"""Frame -> middle of the raised right hand, px."""
HEAD_TO_HIP = 142


@pytest.mark.slow
@cascade
def test_the_raised_hand_of_a_recorded_person_is_tracked(data):
    video = Video.open(data / "wave_webcam" / "wave.mp4")
    centres, _ = track(video.pictures(), CamshiftTracker(), video.rate_hz)
    distance = np.array([np.linalg.norm(centres[i, 1] - mark) for i, mark in RIGHT_HAND.items()]) / HEAD_TO_HIP
    assert (distance < 0.25).sum() >= 7
    assert (distance > 0.5).sum() <= 1
