"""The camshift tracker on drawn scenes with exact truth: skin-coloured discs before several backgrounds."""

import cv2
import numpy as np
import pytest

from common.errors import BadInput
from observer.tracking import camshift, head
from observer.tracking.camshift import CamshiftTracker
from observer.tracking.skin import SkinHistogram
from observer.tracks import Frame, State

SKIN = (105, 140, 200)
SIZE = (240, 320)
HEAD = (160, 70)
REGION = (140, 50, 40, 40)
RATE = 30.0


@pytest.fixture(autouse=True)
def no_cascade(monkeypatch):
    """Discs have no face: the marked region alone."""
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
    for i in range(frames):
        picture = behind.copy()
        cv2.circle(picture, HEAD, 20, SKIN, -1)
        for hand in (right(i), left(i)):
            if hand is not None:
                cv2.circle(picture, (round(hand[0]), round(hand[1])), 11, SKIN, -1)
        noisy = picture * light(i) + rng.normal(0, 4, picture.shape)
        yield np.clip(noisy, 0, 255).astype(np.uint8)


def track(pictures, tracker=None):
    tracker = tracker or CamshiftTracker(face_region=REGION)
    centres, states = [], []
    for i, picture in enumerate(pictures):
        tracks = tracker.update(Frame(int(i * 1e9 / RATE), picture))
        centres.append(tracks.centres)
        states.append(tracks.states)
    return np.array(centres), states


def wave(side, low=150):
    return lambda i: (160 + side * (75 + 25 * np.sin(i / 5)), low + 20 * np.cos(i / 5))


def errors(centres, truth):
    return np.array([np.linalg.norm(c - t) for c, t in zip(centres, map(truth, range(len(centres))), strict=True)])


@pytest.mark.parametrize("kind", ["plain", "cluttered", "skin-toned"])
def test_two_waving_hands_are_followed_by_their_names(kind):
    left, right = wave(1), wave(-1)
    centres, _ = track(scene(left, right, kind))
    for row, truth in ((0, left), (1, right)):
        away = errors(centres[:, row], truth)
        assert np.isfinite(away[15:]).mean() > 0.8
        assert (away[np.isfinite(away)] < 16).mean() > 0.95
    assert np.nanmax(np.linalg.norm(centres[:, 2] - HEAD, axis=1)) < 10


def test_hands_that_cross_keep_their_names():
    def left(i):
        return (160 + 80 * np.cos(max(i - 20, 0) * np.pi / 50), 150 + 8 * np.sin(i / 3))

    def right(i):
        return (160 - 80 * np.cos(max(i - 20, 0) * np.pi / 50), 180 + 8 * np.sin(i / 3))

    centres, _ = track(scene(left, right, frames=70))
    for row, truth in ((0, left), (1, right)):
        away = errors(centres[:, row], truth)[55:]
        assert np.isfinite(away).mean() > 0.7
        assert np.nanmax(away) < 16


def test_a_hand_before_the_face_is_not_seen_and_comes_back():
    def right(i):
        return (
            wave(-1, 72)(i) if i < 30 else (max(85, 160 - 4 * abs(i - 50)), 72 + (20 * np.sin(i / 4) if i > 66 else 0))
        )

    centres, states = track(scene(lambda i: None, right, frames=110))
    assert all(state[1] is not State.SEEN for state in states[49:52])
    assert np.isnan(centres[49:52, 1]).all()
    away = errors(centres[:, 1], right)[80:]
    assert np.isfinite(away).mean() > 0.7
    assert np.nanmax(away) < 16


def test_a_hand_that_leaves_is_missing_until_it_returns():
    def left(i):
        return None if 40 <= i < 80 else wave(1)(i)

    centres, states = track(scene(left, wave(-1), frames=110))
    assert all(state[0] is not State.SEEN for state in states[43:80])
    assert all(state[0] is State.MISSING for state in states[66:80])
    assert (errors(centres[:, 0], wave(1))[95:] < 16).mean() > 0.8


def test_slow_light_does_not_lose_the_hands():
    centres, _ = track(scene(wave(1), wave(-1), light=lambda i: 1.0 - 0.4 * i / 150, frames=150))
    assert (errors(centres[:, 0], wave(1))[100:] < 16).mean() > 0.8


def test_nobody_there_is_missing_and_nothing_is_invented():
    empty = [np.full((*SIZE, 3), 90, np.uint8)] * 5
    centres, states = track(empty)
    assert np.isnan(centres).all()
    assert set(states[-1]) == {State.MISSING}


def test_large_pictures_give_their_own_pixels():
    large = (cv2.resize(p, None, fx=3, fy=3) for p in scene(wave(1), wave(-1), frames=40))
    centres, _ = track(large, CamshiftTracker(face_region=(420, 150, 120, 120)))
    assert np.nanmedian(errors(centres[20:, 1], lambda i: np.array(wave(-1)(i + 20)) * 3)) < 25


@pytest.mark.parametrize(
    "picture", [np.zeros((40, 40), np.uint8), np.zeros((40, 40, 3)), np.zeros((0, 9, 3), np.uint8)]
)
def test_what_is_no_picture_is_one_line(picture):
    with pytest.raises(BadInput, match=r"\(H, W, 3\) of uint8"):
        CamshiftTracker(face_region=REGION).update(Frame(0, picture))


def test_without_a_cascade_and_without_a_region_one_line_says_what_to_do():
    with pytest.raises(BadInput, match="no face cascade; mark a region"):
        CamshiftTracker()


def test_a_saved_histogram_is_the_same_again(tmp_path):
    tracker = CamshiftTracker(face_region=REGION)
    track(scene(wave(1), wave(-1), frames=3), tracker)
    assert tracker.skin is not None
    tracker.skin.save(tmp_path / "skin.npz")
    again = SkinHistogram.load(tmp_path / "skin.npz")
    assert np.array_equal(again.skin, tracker.skin.skin)
    (tmp_path / "bad.npz").write_bytes(b"no")
    with pytest.raises(BadInput, match="a skin histogram of two arrays"):
        SkinHistogram.load(tmp_path / "bad.npz")


def test_skin_is_found_and_dark_pale_and_burnt_pixels_are_not():
    picture = next(iter(scene(wave(1), wave(-1))))
    skin = SkinHistogram.learn(picture, REGION)
    assert skin is not None
    colours = np.array([[SKIN, (5, 5, 9), (200, 200, 201), (254, 254, 255), (160, 90, 40)]], np.uint8)
    back = skin.back_project(colours)[0]
    assert back[0] > 150
    assert (back[1:] == 0).all()


def test_this_opencv_has_a_cascade_or_says_so():
    assert head.have_cascade() or "no face cascade" in head.WHY_NOT
