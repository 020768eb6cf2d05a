"""Several people, small people and long films with the real model: pictures of recorded people pasted together."""

from itertools import cycle, islice, pairwise

import cv2
import numpy as np
import pytest
from mediapipe_stage import follow, pictures, side_by_side

from benchmarks.clips.judging import judge
from benchmarks.clips.learning import Learning, chosen_labels
from benchmarks.clips.material import gesture_clips, pictures_of, recordings
from common.config_sections import FusionConfig
from observer.model.registry import DEFAULT_MODEL
from observer.tracking.mediapipe_pose import MediapipeTracker
from observer.tracking.people import FollowRule
from observer.tracks import Frame

pytest.importorskip("mediapipe")
pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

RATE_HZ = 10.0
SAME = 0.02
"""Distance, in the person's height, within which tracks are the same."""


def tracked(pictures, pose_model, rule=None, rate_hz=RATE_HZ):
    """(F, 3, 2) centres, (F,) heights of the frame around the followed person, and the greatest number of people."""
    tracker = MediapipeTracker(pose_model, rule=rule)
    tracks = follow(tracker, pictures, rate_hz)
    tracker.close()
    people = [each.people for each in tracks]
    heights = [np.nan if p.followed is None else p.followed.bottom - p.followed.top for p in people]
    return np.array([each.centres for each in tracks]), np.array(heights), max(p.count for p in people)


@pytest.fixture(scope="module")
def pairs(data):
    """Clips of different people and movements, two by two."""
    clips = {clip.name: clip for clip in gesture_clips(data)}
    names = [(f"{a}_{n}", f"{b}_{n % 4 + 1}") for a, b in ((1, 2), (3, 4)) for n in (1, 2, 3, 4)]
    return [(clips[one], clips[other]) for one, other in names]


def test_of_two_people_side_by_side_the_followed_one_is_tracked_and_judged_as_alone(data, pairs, pose_model):
    archive = recordings(data)
    learning = Learning(archive, chosen_labels(archive, "four"), DEFAULT_MODEL, {})
    off, first, late = [], [], 0
    for pair in pairs:
        films = [list(pictures_of(clip)) for clip in pair]
        both = side_by_side(*films)
        for side, (clip, film) in enumerate(zip(pair, films, strict=True)):
            alone, heights, _ = tracked(film, pose_model)
            rule = FollowRule("nearest", (0.25 + 0.5 * side, 0.55))
            beside, _, _ = tracked(both[: len(film)], pose_model, rule)
            beside = beside - [side * film[0].shape[1], 0]
            off += list((np.linalg.norm(beside - alone, axis=2) / np.nanmedian(heights)).ravel())
            late += int(np.isnan(beside).all(axis=(1, 2)).sum())
            model = learning.model(clip.subject, "camera")
            words = [
                judge(clip.name, clip.label, centres, RATE_HZ, model, FusionConfig()).first_is_right
                for centres in (alone, beside)
            ]
            first.append(words)
    off = np.array(off)
    same = sum(alone == beside for alone, beside in first)
    print(
        f"\noff by {np.nanmedian(off):.4f} heights (95 % {np.nanpercentile(off, 95):.4f}, most {np.nanmax(off):.3f});"
        f" {late} of {len(off) // 3} pictures before the choice; right alone {sum(a for a, _ in first)}, beside"
        f" {sum(b for _, b in first)}, the same {same} of {len(first)}"
    )
    assert np.nanmedian(off) < SAME / 4
    assert np.nanpercentile(off, 95) < SAME
    assert np.nanmax(off) < 0.1  # never the other person, who is more than two heights away
    assert same >= len(first) - 2


def test_the_followed_one_of_two_never_changes(data, pose_model):
    wave, stand = (list(pictures(data / f"wave_webcam/{name}.mp4"))[:100] for name in ("wave", "stand"))
    both = side_by_side(wave, stand)
    for side in (0, 1):
        centres, _, count = tracked(both, pose_model, FollowRule("nearest", (0.25 + 0.5 * side, 0.5)))
        head = centres[:, 2, 0] / both[0].shape[1]
        assert count >= 2
        assert np.isfinite(head).mean() > 0.9
        assert (np.abs(head[np.isfinite(head)] - 0.25 - 0.5 * side) < 0.2).all()


def passing(room, walkers, px):
    """Pictures in which a person passes before another from right to left, so many px a picture; and where they are."""
    for n, (behind, before) in enumerate(zip(room, walkers, strict=True)):
        shown, middle = np.full((420, 900, 3), 120, np.uint8), 860 - px * max(n - 10, 0)
        shown[:, 60:480] = behind
        left, right = max(middle - 100, 0), min(middle + 100, 900)
        if left < right:
            shown[:, left:right] = before[:, 90:290][:, left - middle + 100 : right - middle + 100]
        yield shown, middle


@pytest.mark.parametrize("px", [12, 20, 30])
def test_a_person_who_passes_before_the_followed_one_is_never_taken_for_that_one(data, pose_model, px):
    room, walkers = (list(pictures(data / f"wave_webcam/{name}.mp4"))[:60] for name in ("wave", "stand"))
    heads = [tracked(film, pose_model)[0][:, 2, 0] for film in (room, walkers)]
    tracker, who = MediapipeTracker(pose_model, rule=FollowRule("nearest", (0.3, 0.5))), []
    for n, (shown, middle) in enumerate(passing(room, walkers, px)):
        head = tracker.update(Frame(n * 10**8, shown)).centres[2, 0]
        first, walker = heads[0][n] + 60, heads[1][n] - 190 + middle
        if np.isnan(head):
            who.append("nobody")
        elif abs(first - walker) > 100:  # else one covers the other
            who.append("walker" if abs(head - walker) < abs(head - first) else "first")
    tracker.close()
    assert who[:30] == ["first"] * 30 or px > 12
    assert who[:10] == ["first"] * 10
    changes = [pair for pair in pairwise(who) if pair[0] != pair[1]]
    assert ("first", "walker") not in changes
    assert ("walker", "first") not in changes


def test_who_raises_a_hand_is_followed(data, pose_model):
    wave, stand = (list(pictures(data / f"wave_webcam/{name}.mp4"))[:60] for name in ("wave", "stand"))
    centres, _, _ = tracked(side_by_side(stand, wave), pose_model, FollowRule("raised_hand"))
    head = centres[:, 2, 0]
    assert np.isfinite(head).any()
    assert (head[np.isfinite(head)] > 420).all()


@pytest.mark.parametrize("tall_px", [177, 117, 90])
def test_a_small_person_is_found_and_tracked_as_a_large_one(data, pose_model, tall_px):
    assert_small_as_large(data, pose_model, tall_px)


def test_a_task_file_finds_a_small_person_too(data, task_file):
    assert_small_as_large(data, str(task_file), 117)


def assert_small_as_large(data, pose_model, tall_px):
    shown = list(pictures(data / "wave_webcam/stand.mp4"))[:60]
    large, heights, _ = tracked(shown, pose_model)
    scale = tall_px / np.nanmedian(heights)
    left, top = 400 - round(210 * scale), 300 - round(210 * scale)
    room = []
    for picture in shown:
        small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        whole = np.full((480, 640, 3), 110, np.uint8)
        whole[top : top + small.shape[0], left : left + small.shape[1]] = small
        room.append(whole)
    found, _, _ = tracked(room, pose_model)
    begin = int(np.isfinite(found).all(axis=(1, 2)).argmax())
    off = np.linalg.norm((found - [left, top]) / scale - large, axis=2)[begin:] / np.nanmedian(heights)
    print(f"\n{tall_px} px: found in picture {begin}, off by {np.nanmedian(off):.3f} heights")
    assert np.isfinite(found).any()
    assert begin <= 20
    assert np.nanmedian(off) < 2 * SAME


def test_ten_minutes_of_a_film_in_a_loop_are_tracked_without_drift(data, pose_model):
    rate_hz, minute = 5.0, 300
    film = list(pictures(data / "wave_webcam/wave.mp4", 2))[:60]  # 12 s: five rounds a minute
    tracker = MediapipeTracker(pose_model)
    shown = islice(cycle(film), 10 * minute)
    tracks = [tracker.update(Frame(round(n * 1e9 / rate_hz), picture)) for n, picture in enumerate(shown)]
    tracker.close()
    centres = np.array([each.centres for each in tracks])
    heights = np.array([np.nan if each.people.followed is None else
                        each.people.followed.bottom - each.people.followed.top for each in tracks])  # fmt: skip
    # The first round settles.
    first, last = (
        np.nanmedian(part.reshape(-1, len(film), 3, 2), axis=0) for part in (centres[60:300], centres[-240:])
    )
    off = np.linalg.norm(last - first, axis=2) / np.nanmedian(heights)
    seen = [np.isfinite(part).mean() for part in (centres[:minute], centres[-minute:])]
    growth = np.nanmedian(heights[-minute:]) / np.nanmedian(heights[:minute])
    print(
        f"\nlast minute against the first: off by {np.nanmedian(off):.4f} heights (most {np.nanmax(off):.3f}), height"
        f" {growth:.3f} times, seen {seen[0]:.1%} and {seen[1]:.1%}"
    )
    assert np.isfinite(heights).all()
    assert np.nanmedian(off) < 0.005
    assert np.nanpercentile(off, 95) < SAME
    assert abs(growth - 1) < 0.02
    assert seen[1] > seen[0] - 0.01
