"""Where somebody stands, from one picture of their body."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.geometry.placement import COMMON, ROOM_M, STANDING, floor_place
from observer.geometry.projection import parallel_matrix, pinhole_matrix, project

PARTS = ("head", "neck", "pelvis", "left_foot", "right_foot", "left_hand")
HEAD_M = 1.55


def standing(x, z):
    """A person of the shape of STANDING; hands anywhere."""
    heights = [STANDING[part.rpartition("_")[2]][0] if "hand" not in part else 1.2 for part in PARTS]
    return np.array([[x, HEAD_M * height, z] for height in heights])


def camera(yaw_deg, pitch_deg):
    return pinhole_matrix(np.radians(yaw_deg), np.radians(pitch_deg), 4.0, 500.0, (320, 240), (0.0, 0.9, 0.0))


@given(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.integers(-180, 180), st.integers(0, 60))
def test_who_stands_is_where_they_stand(x, z, yaw, pitch):
    matrix = camera(yaw, pitch)
    at, covariance = floor_place(matrix, PARTS, project(matrix, standing(x, z)), HEAD_M)
    # The room's own spread draws an unsure distance a little to the middle.
    assert at == pytest.approx([x, z], abs=0.25)
    assert (np.linalg.eigvalsh(covariance) > 0).all()


@given(st.integers(-180, 180), st.integers(0, 40), st.integers(0, 2**32 - 1))
def test_the_covariance_holds_for_people_who_move_as_stated(yaw, pitch, seed):
    matrix, rng, squares = camera(yaw, pitch), np.random.default_rng(seed), []
    for _ in range(40):
        truth, upright = rng.uniform(-1, 1, 2), rng.normal()
        points = standing(*truth)
        for n, part in enumerate(PARTS[:5]):
            _, spread, aside = STANDING[part.rpartition("_")[2]]
            common = 0.0 if part.endswith("foot") else COMMON
            height = np.sqrt(common) * upright + np.sqrt(1 - common) * rng.normal()
            points[n] += HEAD_M * np.array([aside, spread, aside]) * [rng.normal(), height, rng.normal()]
        at, covariance = floor_place(matrix, PARTS, project(matrix, points), HEAD_M)
        squares.append((at - truth) @ np.linalg.solve(covariance, at - truth))
    # chi² with two degrees of freedom has the mean 2.
    assert np.mean(squares) < 3


def test_feet_tell_more_than_a_head():
    matrix = camera(0, 20)
    centres = project(matrix, standing(0.5, 0.5))
    spread = [np.linalg.det(floor_place(matrix, (PARTS[n],), centres[[n]], HEAD_M)[1]) for n in (0, 3)]
    assert spread[1] < spread[0] / 2


def test_a_parallel_view_does_not_know_how_far_away_people_are():
    matrix = parallel_matrix(0.0, 0.0)
    at, covariance = floor_place(matrix, PARTS, project(matrix, standing(0.5, 0.5)), HEAD_M)
    assert at == pytest.approx([0.5, 0.0], abs=0.05)
    assert covariance[0, 0] < 0.1 and covariance[1, 1] == pytest.approx(ROOM_M**2, rel=0.1)


def test_without_a_part_that_tells_it_there_is_no_place():
    assert floor_place(camera(0, 10), ("left_hand",), np.array([[300.0, 200.0]]), HEAD_M) is None
    assert floor_place(camera(0, 10), ("head",), np.array([[np.nan, np.nan]]), HEAD_M) is None


@given(st.integers(-180, 180), st.integers(5, 40), st.sampled_from([-2.0, 2.0]))
def test_who_bends_or_is_taller_stays_where_the_feet_are(yaw, pitch, upright):
    """Two standard deviations lower, as who bends or sits, or higher, as who is taller than the scene says."""
    points = standing(0.4, -0.3)
    for n, part in enumerate(PARTS[:3]):
        points[n, 1] += HEAD_M * upright * STANDING[part.rpartition("_")[2]][1]
    matrix = camera(yaw, pitch)
    at, covariance = floor_place(matrix, PARTS, project(matrix, points), HEAD_M)
    assert np.hypot(*(at - [0.4, -0.3])) < 0.25
    (hidden, spread), feet = floor_place(matrix, PARTS[:3], project(matrix, points[:3]), HEAD_M), [0.4, -0.3]
    assert (hidden - feet) @ np.linalg.solve(spread, hidden - feet) < 9.21, "without feet the place is unsure"
    assert np.linalg.det(spread) > np.linalg.det(covariance)
