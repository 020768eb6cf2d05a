"""The virtual camera films an archive: the same frames at the same times, as pictures, one person for all cameras."""

import itertools
import threading

import numpy as np
import pytest
from observer_stage import rejected

from observer.geometry.projection import project
from observer.geometry.views import View, parse_view
from observer.motion.archive import Recording
from observer.motion.playback import RecordedMotion
from observer.rendering.body import stature
from observer.rendering.virtual_camera import VirtualCamera, aimed_matrix
from observer.tracks import BODY_PARTS

UPRIGHT = np.array([[-0.35, 0.8, -0.05], [0.35, 0.8, -0.05], [0.0, 1.6, 0.0]], np.float32)


def recording(subject="1", frames=4, offset=(0.0, 0.0, 0.0)):
    rise = np.zeros((frames, 3, 3), np.float32)
    rise[:, 1, 1] = np.linspace(0.0, 0.6, frames)
    return Recording(UPRIGHT + rise + np.array(offset, np.float32), 15.0, "raise", subject, "1")


def camera(*recordings, view="door", parts=BODY_PARTS, loop=False, **arguments):
    motion = RecordedMotion(parts, recordings or (recording(),), speed=0.0, loop=loop)
    return VirtualCamera(motion, parse_view(view), **arguments)


def pictures(source):
    return [frame.content for frame in source.frames(threading.Event())]


def test_each_frame_of_motion_is_one_picture_stamped_when_it_was_due():
    ticks = itertools.count(1_000)
    motion = RecordedMotion(BODY_PARTS, (recording(),), speed=0.0, clock=lambda: next(ticks))
    source = VirtualCamera(motion, parse_view("door"))
    frames = list(source.frames(threading.Event()))
    assert len(frames) == 4 and source.rate_hz == 15.0
    assert [frame.captured_ns for frame in frames] == [1_001, 1_002, 1_003, 1_004]
    assert all(frame.content.shape == (480, 640, 3) and frame.content.dtype == np.uint8 for frame in frames)
    assert (frames[0].content != frames[-1].content).any()


def test_the_performers_position_does_not_matter():
    here, there = camera(), camera(recording(offset=(0.5, -0.9, 2.5)))
    differing = [(a.astype(int) != b).mean() for a, b in zip(pictures(here), pictures(there), strict=True)]
    assert max(differing) < 0.02  # the archive's numbers are rounded


def test_the_appearance_depends_on_the_subject_only():
    two = pictures(camera(recording("1", 2), recording("2", 2)))
    assert (two[0] != two[2]).any()
    front, back = pictures(camera(seed=1))[0], pictures(camera(view="yaw:180", seed=2))[0]
    shirt_front, shirt_back = (picture[200:220, 310:330].reshape(-1, 3).mean(axis=0) for picture in (front, back))
    np.testing.assert_allclose(shirt_front, shirt_back, atol=6)


def test_a_loop_continues_until_stopped():
    stop = threading.Event()
    film = camera(loop=True).frames(stop)
    assert len(list(itertools.islice(film, 10))) == 10
    stop.set()
    assert list(film) == []


def test_parts_are_taken_by_their_names():
    turned = recording()
    turned = Recording(turned.positions[:, ::-1].copy(), 15.0, "raise", "1", "1")
    assert (pictures(camera(turned, parts=BODY_PARTS[::-1]))[0] == pictures(camera())[0]).all()
    with rejected("head"):
        pictures(camera(parts=("left_hand", "right_hand", "hip")))


@pytest.mark.parametrize("view", ["door", "wheel", "table", "yaw:45", "yaw:-120,pitch:30"])
def test_the_camera_stands_in_the_direction_of_its_view_and_aims_at_the_middle(view):
    standing = stature(recording().positions)
    parallel = parse_view(view).matrix
    matrix = aimed_matrix(parse_view(view), standing, (640, 480))
    np.testing.assert_allclose(project(matrix, standing.middle), [319.5, 239.5], atol=1e-6)
    assert matrix[2] @ [*standing.middle, 1.0] == pytest.approx(3.5)
    # Near the middle it sees directions as the parallel view does, 1 m as FOCAL * 480 / 3.5 pixels.
    step = np.array([0.001, 0.002, -0.001])
    seen = project(matrix, standing.middle + step) - [319.5, 239.5]
    np.testing.assert_allclose(seen, parallel[:2, :3] @ step * 1.35 * 480 / 3.5, atol=1e-3)
    assert aimed_matrix(View("calibrated", matrix), standing) is matrix
