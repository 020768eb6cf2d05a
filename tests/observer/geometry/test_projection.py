"""Oracle: cameras placed by hand; then laws that hold for all cameras and points."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from observer.geometry.projection import parallel_matrix, pinhole_matrix, project

YAW = st.floats(-math.pi, math.pi)
PITCH = st.floats(-math.pi / 2, math.pi / 2)
COORDINATE = st.floats(-2, 2).map(lambda x: round(x, 3))
POINT = st.tuples(COORDINATE, COORDINATE, COORDINATE).map(np.array)
RIGHT, UP, FRONT = np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), np.array([0, 0, -1.0])


def camera(yaw=0.0, pitch=0.0, distance=4.0, target=(0.0, 0.0, 0.0)):
    return pinhole_matrix(yaw, pitch, distance, 800.0, (640.0, 360.0), target)


@pytest.mark.parametrize(
    ("yaw_deg", "pitch_deg", "right", "up", "front"),
    [
        (0, 0, (-1, 0), (0, -1), (0, 0)),  # from the front: his right is image left
        (90, 0, (0, 0), (0, -1), (1, 0)),  # from his right: he looks to image right
        (180, 0, (1, 0), (0, -1), (0, 0)),  # from behind
        (-90, 0, (0, 0), (0, -1), (-1, 0)),  # from his left
        (0, 90, (-1, 0), (0, 0), (0, 1)),  # from above, risen from the front: he looks down the image
    ],
)
def test_the_performers_directions_in_the_image(yaw_deg, pitch_deg, right, up, front):
    matrix = parallel_matrix(math.radians(yaw_deg), math.radians(pitch_deg))
    seen = project(matrix, np.stack([RIGHT, UP, FRONT]))
    np.testing.assert_allclose(seen, [right, up, front], atol=1e-12)


def test_pinhole_by_hand():
    matrix = camera(distance=4.0, target=(0.0, 1.0, 0.0))
    # The camera stands at (0, 1, -4). A point 1 m to his right, 0.5 m above the target and 1 m to his back is 5 m deep.
    np.testing.assert_allclose(project(matrix, np.array([1.0, 1.5, 1.0])), [640 - 800 / 5, 360 - 800 * 0.5 / 5])
    np.testing.assert_allclose(project(matrix, np.array([0.0, 1.0, 0.0])), [640, 360])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_not_finite_in_gives_nan(bad, axis):
    points = np.zeros((2, 3))
    points[0, axis] = bad
    for matrix in (camera(), parallel_matrix(0.0, 0.0)):
        seen = project(matrix, points)
        assert np.isnan(seen[0]).all()
        assert np.isfinite(seen[1]).all()


@pytest.mark.parametrize("factor", [1.0, -1.0, 1e-150, -1e150, 3.7])
def test_behind_is_nan_at_every_scale(factor):
    points = np.array([[0.3, 0.2, 1.0], [0.3, 0.2, -4.0], [0.3, 0.2, -4.1], [0.0, 0.0, -4.0]])
    seen = project(camera() * factor, points)
    np.testing.assert_allclose(seen[0], [640 - 0.3 * 160, 360 - 0.2 * 160])
    assert np.isnan(seen[1:]).all()


def test_a_parallel_projection_has_nothing_behind():
    points = np.array([[0.0, 0, 100.0], [0.0, 0, -100.0]])
    for factor in (1.0, -2.0):
        assert (project(parallel_matrix(0, 0) * factor, points) == 0).all()


@pytest.mark.parametrize("matrix", [np.zeros((3, 4)), np.full((3, 4), np.nan), np.ones((3, 4))])
def test_a_matrix_that_is_not_a_camera_gives_nan(matrix):
    assert np.isnan(project(matrix, np.ones((2, 3)))).all()


@given(YAW, PITCH, POINT, st.floats(0.5, 8), POINT)
def test_points_in_front_are_finite_and_behind_are_nan(yaw, pitch, target, distance, point):
    towards = np.array(
        [math.sin(yaw) * math.cos(pitch), math.sin(pitch), -math.cos(yaw) * math.cos(pitch)]
    )  # from the target to the camera
    depth = (target + distance * towards - point) @ towards
    assume(abs(depth) > 1e-9)
    seen = project(camera(yaw, pitch, distance, target), point)
    assert np.isfinite(seen).all() == (depth > 0)


@given(YAW, PITCH, POINT, st.floats(0.1, 8), st.floats(-2, 2))
def test_the_camera_plane_is_nan_despite_rounding(yaw, pitch, target, distance, aside):
    matrix = camera(yaw, pitch, distance, target)
    in_plane = np.linalg.solve(matrix[:, :3], -matrix[:, 3]) + aside * parallel_matrix(yaw, pitch)[0, :3]
    assert np.isnan(project(matrix, in_plane)).all()


@given(YAW, PITCH)
def test_images_are_rigid_and_not_mirrored(yaw, pitch):
    rows = parallel_matrix(yaw, pitch)[:2, :3]
    np.testing.assert_allclose(rows @ rows.T, np.eye(2), atol=1e-12)
    looking = -np.array([math.sin(yaw) * math.cos(pitch), math.sin(pitch), -math.cos(yaw) * math.cos(pitch)])
    np.testing.assert_allclose(np.cross(rows[0], rows[1]), looking, atol=1e-12)
    assert rows[1, 1] <= 1e-12  # up is never seen downwards
