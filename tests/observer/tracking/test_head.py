"""Finding a head by its skin: drawn patches, and a rendered performer from all sides."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.geometry.projection import project
from observer.geometry.views import facing, parse_view
from observer.motion.archive import Recording
from observer.motion.playback import RecordedMotion
from observer.rendering.body import stature
from observer.rendering.scenery import Scenery
from observer.rendering.virtual_camera import VirtualCamera, aimed_matrix
from observer.tracking.camshift import CamshiftTracker
from observer.tracking.head import MOST_PATCHES, topmost_skin
from observer.tracking.skin import SkinHistogram
from observer.tracks import BODY_PARTS, Frame

HEAD_PX = 40
COLOUR, WALL = (105, 140, 200), (120, 110, 60)


def drawn(*patches, size=(240, 320)):
    picture = np.full((*size, 3), WALL, np.uint8)
    for u, v, radius in patches:
        cv2.circle(picture, (u, v), radius, COLOUR, -1)
    return picture


SKIN = SkinHistogram.learn(drawn((160, 70, 30)), (130, 40, 60, 60))


@given(st.integers(60, 260), st.integers(30, 120), st.integers(8, 20), st.integers(1, 3))
def test_the_topmost_patch_is_the_head_at_any_size_of_picture(u, v, radius, scale):
    hands = [(u - 40, v + 80, radius // 2 + 2), (u + 40, v + 85, radius // 2 + 2)]
    parts = [(scale * a, scale * b, scale * r) for a, b, r in [(u, v, radius), *hands]]
    box = topmost_skin(drawn(*parts, size=(240 * scale, 320 * scale)), SKIN)
    assert box is not None
    x, y, width, height = box
    assert np.hypot(x + width / 2 - scale * u, y + height / 2 - scale * v) < 3 * scale
    assert width == height and 1.5 < width / (scale * radius) < 2.8


@pytest.mark.parametrize(
    "patches",
    [
        [],
        [(100, 60, 15), (200, 62, 15)],
        [(160, 60, 2)],
        [(160, 120, 100)],
        [(20 + 40 * i, 60 + 20 * i, 10) for i in range(MOST_PATCHES + 1)],
    ],
    ids=["nothing", "two equally high", "too small", "a wall", "too many"],
)
def test_ambiguous_patches_give_no_head(patches):
    assert topmost_skin(drawn(*patches), SKIN) is None


@pytest.mark.parametrize("view", ["yaw:45,pitch:20", "yaw:135,pitch:20", "yaw:225,pitch:20", "yaw:315,pitch:20"])
def test_the_head_of_a_rendered_performer_is_found_from_every_corner(view):
    standing = np.array([[-0.35, 0.95, 0.0], [0.35, 0.95, 0.0], [0.0, 1.65, 0.0]], np.float32)
    recording = Recording(np.repeat(standing[None], 2, axis=0), 30.0, "rest", "1", "1")

    def picture(view_name):
        motion = RecordedMotion(BODY_PARTS, (recording,), speed=0)
        camera = VirtualCamera(motion, parse_view(view_name), scenery=Scenery("cluttered", 3.0))
        return camera.renderer(recording).picture(standing.astype(float), 0, None)

    def head(view_name):
        return project(aimed_matrix(parse_view(view_name), stature(recording.positions)), standing[2].astype(float))

    u, v = head("door")
    skin = SkinHistogram.learn(picture("door"), (round(u) - 18, round(v) - 18, 36, 36))
    box = topmost_skin(picture(view), skin)
    assert box is not None
    distance = np.hypot(box[0] + box[2] / 2 - head(view)[0], box[1] + box[3] / 2 - head(view)[1])
    assert distance < HEAD_PX / 2


@pytest.mark.parametrize("view_name", ["yaw:45,pitch:20", "yaw:135,pitch:20"])
def test_with_a_saved_histogram_left_and_right_are_tracked_from_front_and_behind(view_name):
    t = np.arange(60) / 30.0
    positions = np.zeros((len(t), 3, 3), np.float32)
    positions[:, 0] = np.stack([-0.55 + 0 * t, 1.2 + 0.25 * np.sin(5 * t), 0 * t], axis=1)
    positions[:, 1] = np.stack([0.55 + 0 * t, 1.2 + 0.25 * np.cos(5 * t), 0 * t], axis=1)
    positions[:, 2] = (0.0, 1.65, 0.0)
    recording = Recording(positions, 30.0, "wave", "1", "1")

    def pictures(view):
        camera = VirtualCamera(RecordedMotion(BODY_PARTS, (recording,), speed=0), parse_view(view))
        draw = camera.renderer(recording)
        return [draw.picture(p, n, None) for n, p in enumerate(positions.astype(float))]

    u, v = project(aimed_matrix(parse_view("door"), stature(positions)), positions[0, 2].astype(float))
    skin = SkinHistogram.learn(pictures("door")[0], (round(u) - 18, round(v) - 18, 36, 36))
    view = parse_view(view_name)
    tracker = CamshiftTracker(skin, facing=facing(view))
    seen = np.array([tracker.update(Frame(round(n * 1e9 / 30), p)).centres for n, p in enumerate(pictures(view_name))])
    truth = project(aimed_matrix(view, stature(positions)), positions.astype(float))
    distance = np.linalg.norm(seen[:, :2] - truth[:, :2], axis=2)
    assert (np.isfinite(distance[20:]).mean(axis=0) > 0.5).all()
    assert np.nanmax(distance) < HEAD_PX / 2
