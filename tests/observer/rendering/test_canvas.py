"""The lens: where the camera stands, its focal length, and the outline of an ellipsoid, from the matrix alone."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.geometry.projection import pinhole_matrix, project
from observer.rendering.canvas import PinholeCamera


@given(st.floats(-3.0, 3.0), st.floats(-1.4, 1.4), st.floats(0.5, 8.0), st.floats(200.0, 2000.0), st.floats(-3.0, 3.0))
def test_the_matrix_determines_the_camera(yaw_rad, pitch_rad, distance, focal_px, factor):
    if abs(factor) < 0.01:
        return
    matrix = pinhole_matrix(yaw_rad, pitch_rad, distance, focal_px, (320.0, 240.0), (0.1, 1.0, 2.0))
    lens = PinholeCamera(factor * matrix)
    sight = matrix[2, :3] / np.linalg.norm(matrix[2, :3])
    np.testing.assert_allclose(lens.centre, [0.1, 1.0, 2.0] - distance * sight, atol=1e-6)
    assert lens.focal_px == pytest.approx(focal_px)
    points = np.array([[0.1, 1.0, 2.0], [0.2, 1.1, 1.95]])
    pixels, depth = lens.project(points)
    assert depth[0] == pytest.approx(distance)
    np.testing.assert_allclose(pixels, project(matrix, points), atol=1e-6)


@given(st.tuples(*[st.floats(-0.5, 0.5)] * 3), st.integers(0, 1000))
def test_the_outline_is_the_tight_hull_of_the_ellipsoid(centre, seed):
    rng = np.random.default_rng(seed)
    matrix = pinhole_matrix(0.7, 0.3, 3.5, 650.0, (320.0, 240.0))
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0] * [0.045, 0.09, 0.045]
    pixel, _, _, Q = PinholeCamera(matrix).conic(np.array(centre), axes)
    ball = rng.normal(size=(4000, 3))
    surface = np.array(centre) + (ball / np.linalg.norm(ball, axis=1, keepdims=True)) @ axes.T
    off = project(matrix, surface) - pixel
    outward = np.sqrt(np.einsum("ki,ij,kj->k", off, Q, off))
    assert outward.max() == pytest.approx(1.0, abs=0.05)  # perspective within the ellipsoid is left out
