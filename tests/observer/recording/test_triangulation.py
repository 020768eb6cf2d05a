"""Triangulation: exact points and wrong cameras."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from observer_stage import rejected

from observer.geometry.projection import pinhole_matrix, project
from observer.recording.triangulation import GATE_PX, _linear_points, triangulate_all

CAMERAS = np.array([pinhole_matrix(yaw, 0.2, 4.0, 900, (640, 360)) for yaw in (-0.8, 0.0, 0.9, 2.0)])
SCALES = np.array([1.0, -3.0, 1e-3, 1e4])[:, None, None]


def triangulate(matrices, pixels, gate_px=GATE_PX):
    """The point (3,), which cameras (N,) are used, and their errors (N,)."""
    result = triangulate_all(matrices, pixels[None], gate_px)
    return SimpleNamespace(point=result.points[0], used=result.used[0], errors_px=result.errors_px[0])


@given(st.tuples(*[st.floats(-1, 1)] * 3), st.permutations(range(4)))
def test_exact_pixels_give_the_exact_point_in_any_order_and_scale(point, order):
    pixels = np.array([project(H, np.array(point)) for H in CAMERAS])
    result = triangulate((CAMERAS * SCALES)[order], pixels[order])
    np.testing.assert_allclose(result.point, point, atol=1e-6)
    assert result.used.all() and result.errors_px.max() < 1e-4


def test_the_scale_of_a_matrix_does_not_weight_its_camera_in_the_linear_solution():
    pixels = np.array([project(H, np.zeros(3)) for H in CAMERAS]) + np.random.default_rng(1).normal(0, 3, (4, 2))
    used = np.ones((1, 4), bool)
    plain, scaled = (_linear_points(Hs, pixels[None], used) for Hs in (CAMERAS, CAMERAS * np.abs(SCALES)))
    np.testing.assert_allclose(scaled, plain, atol=1e-9)


@pytest.mark.parametrize("wrong", range(4))
def test_a_wrong_camera_is_an_outlier(wrong):
    point = np.array([0.2, 0.1, -0.3])
    pixels = np.array([project(H, point) for H in CAMERAS]) + 1.0
    pixels[wrong] += [150, -90]
    pixels[wrong - 1] = np.nan
    result = triangulate(CAMERAS, pixels)
    assert result.used.sum() == 2 and not result.used[wrong]
    np.testing.assert_allclose(result.point, point, atol=0.02)
    assert result.errors_px[wrong] > 100 and np.isnan(result.errors_px[wrong - 1])


def test_the_refined_point_is_the_least_squares_point():
    rng = np.random.default_rng(3)
    pixels = np.array([project(H, np.zeros(3)) for H in CAMERAS]) + rng.normal(0, 3, (4, 2))
    best = triangulate(CAMERAS, pixels)
    for step in np.vstack([np.eye(3), -np.eye(3)]) * 1e-4:
        off = np.array([project(H, best.point + step) for H in CAMERAS]) - pixels
        assert (off**2).sum() > (best.errors_px**2).sum()


def test_without_two_agreeing_cameras_there_is_no_point():
    pixels = np.full((4, 2), np.nan)
    assert np.isnan(triangulate(CAMERAS, pixels).point).all()
    pixels[0] = 640, 360
    alone = triangulate(CAMERAS, pixels)
    assert np.isnan(alone.point).all() and not alone.used.any()
    pixels[1] = 640, 900
    assert np.isnan(triangulate(CAMERAS, pixels).point).all()


def test_shapes_and_gate_are_checked():
    with rejected("one row per camera"):
        triangulate(CAMERAS, np.zeros((3, 2)))
    with rejected("gate_px"):
        triangulate(CAMERAS, np.zeros((4, 2)), gate_px=0)


@pytest.mark.parametrize("order", [[0, 1, 2, 3], [2, 3, 0, 1], [0, 2, 1, 3]])
def test_of_two_pairs_that_contradict_each_other_the_one_that_agrees_better_wins(order):
    point, other = np.array([0.1, 0.0, 0.2]), np.array([-0.6, 0.5, -0.4])
    pixels = np.array([project(H, point) for H in CAMERAS[:2]] + [project(H, other) for H in CAMERAS[2:]])
    pixels[3] += (0, 8)
    result = triangulate(CAMERAS[order], pixels[order])
    np.testing.assert_allclose(result.point, point, atol=1e-6)
    assert [order[n] for n in np.flatnonzero(result.used)] == [n for n in order if n < 2]


def test_the_majority_outvotes_two_cameras_that_agree_exactly():
    rng = np.random.default_rng(4)
    pixels = np.array([project(H, np.zeros(3)) for H in CAMERAS]) + rng.normal(0, 2, (4, 2))
    behind = CAMERAS[0][:, :3] @ np.array([0.5, 0.3, 0.2]) + CAMERAS[0][:, 3]
    wrong = np.linalg.solve(CAMERAS[0][:, :3], np.array([*pixels[0], 1.0]) * behind[2] - CAMERAS[0][:, 3])
    pixels[3] = project(CAMERAS[3], wrong)
    result = triangulate(CAMERAS, pixels)
    assert result.used.tolist() == [True, True, True, False]
    assert np.linalg.norm(result.point) < 0.05
