"""Finding a head by its skin: drawn patches, and a rendered performer from all sides."""

from dataclasses import dataclass

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
from observer.rendering.virtual_camera import PERFECT, VirtualCamera, aimed_matrix
from observer.tracking.camshift import CamshiftTracker
from observer.tracking.head import MOST_PATCHES, HeadTracker, topmost_skin
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


@dataclass(frozen=True, slots=True)
class RenderedPerformer:
    """(F, 3, 3) metres, seen by virtual cameras."""

    positions: np.ndarray
    scenery: Scenery = PERFECT

    def pictures(self, view):
        recording = Recording(self.positions, 30.0, "wave", "1", "1")
        camera = VirtualCamera(
            RecordedMotion(BODY_PARTS, (recording,), speed=0), parse_view(view), scenery=self.scenery
        )
        draw = camera.renderer(recording)
        return [draw.picture(p, n) for n, p in enumerate(self.positions.astype(float))]

    def truth(self, view):
        """(F, 3, 2) px."""
        return project(aimed_matrix(parse_view(view), stature(self.positions)), self.positions.astype(float))

    def skin(self):
        """Learned from the face as the door sees it."""
        u, v = self.truth("door")[0, 2]
        return SkinHistogram.learn(self.pictures("door")[0], (round(u) - 18, round(v) - 18, 36, 36))


@pytest.fixture(scope="module")
def standing():
    performer = RenderedPerformer(
        np.array([[[-0.35, 0.95, 0.0], [0.35, 0.95, 0.0], [0.0, 1.65, 0.0]]], np.float32), Scenery("cluttered", 3.0)
    )
    return performer, performer.skin()


@pytest.fixture(scope="module")
def waving():
    t = np.arange(60) / 30.0
    positions = np.zeros((len(t), 3, 3), np.float32)
    positions[:, 0] = np.stack([-0.55 + 0 * t, 1.2 + 0.25 * np.sin(5 * t), 0 * t], axis=1)
    positions[:, 1] = np.stack([0.55 + 0 * t, 1.2 + 0.25 * np.cos(5 * t), 0 * t], axis=1)
    positions[:, 2] = (0.0, 1.65, 0.0)
    performer = RenderedPerformer(positions)
    return performer, performer.skin()


@pytest.mark.parametrize("view", ["yaw:45,pitch:20", "yaw:135,pitch:20", "yaw:225,pitch:20", "yaw:315,pitch:20"])
def test_the_head_of_a_rendered_performer_is_found_from_every_corner(standing, view):
    performer, skin = standing
    box = topmost_skin(performer.pictures(view)[0], skin)
    assert box is not None
    u, v = performer.truth(view)[0, 2]
    assert np.hypot(box[0] + box[2] / 2 - u, box[1] + box[3] / 2 - v) < HEAD_PX / 2


@pytest.mark.parametrize("view", ["yaw:45,pitch:20", "yaw:135,pitch:20"])
def test_with_a_saved_histogram_left_and_right_are_tracked_from_front_and_behind(waving, view):
    performer, skin = waving
    tracker = CamshiftTracker(skin, facing=facing(parse_view(view)))
    frames = [Frame(round(n * 1e9 / 30), picture) for n, picture in enumerate(performer.pictures(view))]
    centres = np.array([tracker.update(frame).centres for frame in frames])
    distance = np.linalg.norm(centres[:, :2] - performer.truth(view)[:, :2], axis=2)
    assert (np.isfinite(distance[20:]).mean(axis=0) > 0.5).all()
    assert np.nanmax(distance) < HEAD_PX / 2


class CountingFinder:
    """Finds a face in the n-th search of a whole picture and from then on; counts these searches."""

    def __init__(self, appears_at):
        self.whole, self._appears_at = 0, appears_at

    def find(self, picture, smallest):
        self.whole += 1
        return [(300, 200, 40, 40)] if self.whole >= self._appears_at else []


class LargestSearch:
    """Finds no face; remembers the largest picture that was searched, in pixels."""

    def __init__(self):
        self.largest = 0

    def find(self, picture, smallest):
        self.largest = max(self.largest, picture.shape[0] * picture.shape[1])
        return []


@pytest.mark.parametrize("shown", [((160, 70, 20), (100, 180, 12)), ()])
def test_with_a_known_colour_a_face_is_searched_about_the_head_and_elsewhere_only_without_one(shown):
    picture, finder = drawn(*shown), LargestSearch()
    head = HeadTracker(finder, SKIN)
    boxes = [head.search(picture, None, 0.1) for _ in range(3)]
    assert (boxes[-1] is not None) == bool(shown)
    share = finder.largest / (picture.shape[0] * picture.shape[1])
    assert (0 < share < 0.2) if shown else share == 1


def test_a_face_near_a_head_that_is_followed_is_searched_ever_less_often():
    picture, finder = drawn((160, 70, 20)), CountingFinder(appears_at=10**6)
    head, near, counts = HeadTracker(finder, SKIN), np.array([160.0, 70.0]), []
    for _ in range(20 * 30):
        head.search(picture, near, 1 / 30)
        counts.append(finder.whole)
    assert counts[59] >= 6 and 9 <= counts[-1] - counts[300] <= 11


def test_a_face_that_is_nowhere_is_searched_ever_less_often_and_found_when_it_comes():
    picture, finder = np.zeros((480, 640, 3), np.uint8), CountingFinder(appears_at=60)
    head, seconds, counts = HeadTracker(finder, None), 1 / 30, {}
    for n in range(60 * 30):
        box = head.search(picture, None, seconds)
        counts[n // 30] = finder.whole
        if box is not None:
            break
    assert counts[1] >= 15, "a face that was just lost is searched often"
    assert counts[20] - counts[10] == 10
    assert finder.whole == 61, "found twice"
    assert box == pytest.approx((300, 200, 40, 40), abs=1)
