"""The lens against the formulas that define it, and turned round."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from observer_stage import rejected

from observer.geometry.projection import DISTORTION_SIZES, LensDistortion, undistorted

K = np.array([[800.0, 0, 330], [0, 810, 250], [0, 0, 1]])
STRONG = np.array([-0.3, 0.1, 1e-3, -2e-3, 0.02, 0.05, -0.02, 0.01])
DISTORTIONS = [STRONG[:size] for size in DISTORTION_SIZES]


def drawn_at(x, y, k1, k2, p1, p2, k3):
    """Brown-Conrady, as OpenCV's manual writes it."""
    r2 = x**2 + y**2
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    return (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2), y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y)


@given(
    st.sampled_from(DISTORTIONS),
    st.floats(-0.5, 1.5),
    st.lists(st.tuples(st.floats(0, 640), st.floats(0, 480)), min_size=1, max_size=5),
)
def test_undistortion_inverts_distortion(distortion, strength, pixels):
    lens, centres = LensDistortion(K, distortion * strength), np.array(pixels)
    np.testing.assert_allclose(lens.distorted(lens.undistorted(centres)), centres, atol=2e-3)
    np.testing.assert_allclose(lens.undistorted(lens.distorted(centres)), centres, atol=2e-3)


def test_a_skewed_intrinsic_matrix():
    skewed = K + np.array([[0, 12.0, 0], [0, 0, 0], [0, 0, 0]])
    lens, points = LensDistortion(skewed, STRONG[:5]), np.array([[0.2, -0.1], [-0.3, 0.25]])
    plain = points @ skewed[:2, :2].T + skewed[:2, 2]
    there = np.array([drawn_at(*point, *STRONG[:5]) for point in points]) @ skewed[:2, :2].T + skewed[:2, 2]
    np.testing.assert_allclose(lens.distorted(plain), there, atol=1e-9)
    np.testing.assert_allclose(lens.undistorted(there), plain, atol=1e-3)


def test_nan_stays_nan_and_does_not_affect_other_rows():
    lens = LensDistortion(K, STRONG[:5])
    both = lens.undistorted(np.array([[np.nan, np.nan], [100.0, 80.0], [5.0, np.nan]]))
    assert np.isnan(both[[0, 2]]).all()
    np.testing.assert_allclose(both[1], lens.undistorted(np.array([[100.0, 80.0]]))[0], atol=1e-6)
    np.testing.assert_allclose(
        LensDistortion(K, np.zeros(5)).undistorted(np.array([[7.0, 9.0]])), [[7.0, 9.0]], atol=1e-9
    )


def test_pixels_beyond_the_fold_are_nan():
    fold = 1 / np.sqrt(3 * 0.4)  # r (1 - 0.4 r²) is largest here
    most = fold * (1 - 0.4 * fold**2)
    places = np.array([[0.99 * most, 0.0], [1.01 * most, 0.0]])
    inside, outside = undistorted(places, np.array([-0.4, 0, 0, 0]))
    assert 0.8 * fold < inside[0] < fold
    assert np.isnan(outside).all()


@pytest.mark.parametrize(
    ("matrix", "distortion", "message"),
    [
        (K[:2], STRONG[:5], "not an intrinsic matrix"),
        (K * [[-1], [1], [1]], STRONG[:5], "not an intrinsic matrix"),
        (K * np.nan, STRONG[:5], "not an intrinsic matrix"),
        (K, STRONG[:3], "distortion: 3 numbers"),
        (K, STRONG[:5] * np.nan, "not finite"),
    ],
)
def test_an_invalid_lens_is_rejected(matrix, distortion, message):
    with rejected(message):
        LensDistortion(matrix, distortion)
