"""The contract of every tracker in the registry."""

import importlib.util
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from common.config import ObserverConfig
from common.errors import BadInput
from observer.geometry.views import parse_view
from observer.motion.archive import Recording
from observer.motion.playback import RecordedMotion
from observer.rendering.virtual_camera import VirtualCamera
from observer.tracking.registry import TRACKERS, tracker_named
from observer.tracking.tracker_kind import TrackerSettings
from observer.tracks import BODY_PARTS, Frame, State

DOOR = parse_view("door")
RATE = 20.0
NOTHING = {
    "positions": np.full((3, 3), np.nan),
    "tracks": np.full((3, 3), np.nan),
    "pictures": np.full((240, 320, 3), 90, np.uint8),
}
PERIOD_NS = int(1e9 / RATE)


def motion(seconds=2.0):
    t = np.arange(round(seconds * RATE)) / RATE
    positions = np.zeros((len(t), 3, 3), np.float32)
    positions[:, 0] = (-0.35, 0.95, -0.1)
    positions[:, 1] = np.stack([0.4 + 0.2 * np.sin(8 * t), 1.4 + 0 * t, -0.3 + 0 * t], axis=1)
    positions[:, 2] = (0, 1.65, 0)
    return Recording(positions, RATE, "wave", "1", "1")


@cache
def contents(reads):
    """Forty frames; drawing them takes as long as tracking them."""
    recording = motion()
    if reads == "positions":
        return list(recording.positions.astype(float))
    if reads == "tracks":
        return [np.hstack([p[:, :2] * [-1, -1], np.ones((3, 1))]) for p in recording.positions.astype(float)]
    camera = VirtualCamera(RecordedMotion(BODY_PARTS, (recording,), speed=0.0), DOOR)
    draw = camera.renderer(recording)
    return [draw.picture(p, n) for n, p in enumerate(recording.positions.astype(float))]


@pytest.fixture(params=TRACKERS.values(), ids=lambda kind: kind.name)
def kind(request):
    if request.param.name == "mediapipe" and importlib.util.find_spec("mediapipe") is None:
        pytest.skip("mediapipe is not installed here; make test-mediapipe has it")
    return request.param


@pytest.fixture
def settings():
    return TrackerSettings(DOOR, BODY_PARTS, BODY_PARTS, ObserverConfig(source="0"), Path)


@pytest.fixture
def tracker(kind, settings):
    return kind.build(settings)


def updated(tracker, frames):
    return [tracker.update(Frame(n * PERIOD_NS, content)) for n, content in enumerate(frames)]


def test_there_is_one_row_per_named_part(kind, tracker):
    assert set(kind.finds or BODY_PARTS) <= set(tracker.body_parts)
    for tracks in updated(tracker, contents(kind.reads)[:5]):
        assert tracks.centres.shape == (len(tracker.body_parts), 2)
        assert len(tracks.states) == len(tracker.body_parts)


def test_an_empty_picture_has_no_seen_part(kind, tracker):
    for tracks in updated(tracker, [NOTHING[kind.reads]] * 5):
        assert np.isnan(tracks.centres).all() and State.SEEN not in tracks.states


def test_a_lost_part_is_never_at_the_origin(kind, tracker):
    frames = contents(kind.reads)
    for tracks in updated(tracker, [*frames, *[NOTHING[kind.reads]] * 30, *frames]):
        assert not (tracks.centres == 0).all(axis=1).any()


def test_the_same_frames_give_the_same_tracks(kind, tracker, settings):
    again = kind.build(settings)
    for one, other in zip(updated(tracker, contents(kind.reads)), updated(again, contents(kind.reads)), strict=True):
        assert np.array_equal(one.centres, other.centres, equal_nan=True)


def test_the_right_hand_is_left_of_the_head_in_the_picture(kind, tracker):
    """An unmirrored picture from the door shows the performer's right hand on its left."""
    if not {"right_hand", "head"} <= {*tracker.body_parts}:
        pytest.skip("it does not look for both")
    hand, head = map(list(tracker.body_parts).index, ("right_hand", "head"))
    seen = [t.centres for t in updated(tracker, contents(kind.reads)) if t.visible[hand] and t.visible[head]]
    assert all(centres[hand, 0] < centres[head, 0] for centres in seen)
    if kind.name != "mediapipe":  # it does not detect a drawn performer
        assert len(seen) > 10


def test_an_unknown_name_is_rejected():
    with pytest.raises(BadInput, match=f"known: auto, {', '.join(TRACKERS)}"):
        tracker_named("eyes", "tracker", "pictures")
