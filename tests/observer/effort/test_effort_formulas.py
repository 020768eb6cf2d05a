"""Properties of the formulas of Effort and Shape."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from observer.effort.features import DEGREE, coefficients, derivatives, window_frames
from observer.effort.formulas import advancing, flow, rising, space, spreading, time, triangle, weight

RATE = 60.0
SHARES = np.array([0.4, 0.4, 0.2])
TRACKS = arrays(np.float64, (20, 3, 3), elements=st.integers(-40, 40).map(lambda n: n / 10))


def waved(tempo, seconds=10.0, rate_hz=RATE):
    """Hands on slow curves, the head still; `tempo` times as fast and over in 1/tempo of the time."""
    t = np.arange(round(seconds / tempo * rate_hz)) / rate_hz * tempo
    left = np.stack([np.sin(0.9 * t), 0.3 * np.cos(0.7 * t), 0.1 * t], axis=1)
    right = np.stack([0.5 * np.cos(1.1 * t), np.sin(0.8 * t), -0.05 * t], axis=1)
    return np.stack([left, right, np.zeros_like(left)], axis=1)


@settings(max_examples=25)
@given(TRACKS)
def test_space_is_at_least_one(tracks):
    assert space(tracks, SHARES) >= 1 - 1e-12


@settings(max_examples=25)
@given(st.floats(0.1, 5), st.integers(2, 30))
def test_space_is_one_on_a_straight_line_at_any_speed(length, frames):
    rng = np.random.default_rng(frames)
    way = np.concatenate([[0.0], np.sort(rng.random(frames)), [1.0]])
    straight = way[:, None, None] * np.array([[[1.0, 0.5, -0.2], [-0.3, 2.0, 0.1], [0.1, 0.1, 0.4]]]) * length
    assert space(straight, SHARES) == pytest.approx(1)


def test_space_is_infinite_for_a_closed_path():
    there = np.linspace(0, 1, 10)[:, None, None] * np.ones((1, 3, 2))
    assert space(np.concatenate([there, there[::-1]]), SHARES) == math.inf
    assert space(np.concatenate([there, there[::-1][:5]]), SHARES) == pytest.approx((1 + 4 / 9) / (5 / 9), rel=0.01)


@pytest.mark.parametrize("tempo", [0.6, 1.7, 3.0])
def test_retiming_scales_weight_and_time_by_the_square_flow_by_the_cube_and_space_not_at_all(tempo):
    slow, fast = waved(1.0), waved(tempo)
    assert weight(fast, RATE, SHARES) / weight(slow, RATE, SHARES) == pytest.approx(tempo**2, rel=0.05)
    assert time(fast, RATE, SHARES) / time(slow, RATE, SHARES) == pytest.approx(tempo**2, rel=0.05)
    assert flow(fast, RATE, SHARES) / flow(slow, RATE, SHARES) == pytest.approx(tempo**3, rel=0.05)
    assert space(fast, SHARES) == pytest.approx(space(slow, SHARES), rel=0.02)


@pytest.mark.parametrize("rate_hz", [30.0, 120.0])
def test_the_frame_rate_does_not_change_the_values(rate_hz):
    for formula in (weight, time, flow):
        assert formula(waved(1.0, rate_hz=rate_hz), rate_hz, SHARES) == pytest.approx(
            formula(waved(1.0), RATE, SHARES), rel=0.05
        )


def test_values_scale_with_length_and_weight_with_its_square():
    tracks = waved(1.0)
    assert weight(2 * tracks, RATE, SHARES) == pytest.approx(4 * weight(tracks, RATE, SHARES))
    assert time(2 * tracks, RATE, SHARES) == pytest.approx(2 * time(tracks, RATE, SHARES))
    assert flow(2 * tracks, RATE, SHARES) == pytest.approx(2 * flow(tracks, RATE, SHARES))
    assert space(2 * tracks, SHARES) == pytest.approx(space(tracks, SHARES))


def test_still_is_zero():
    still = np.ones((30, 3, 2)) * 3.7
    assert weight(still, RATE, SHARES) == pytest.approx(0, abs=1e-12)
    assert time(still, RATE, SHARES) == pytest.approx(0, abs=1e-9)
    assert flow(still, RATE, SHARES) == pytest.approx(0, abs=1e-6)
    assert space(still, SHARES) == 1
    for shape in (spreading, rising):
        assert shape(still, RATE) == pytest.approx(0, abs=1e-9)


def test_a_projection_gives_lower_bounds():
    whole = waved(1.0)
    flat = whole[:, :, :2]
    for formula in (weight, time, flow):
        assert formula(flat, RATE, SHARES) <= formula(whole, RATE, SHARES)


def test_unseen_parts_have_no_share_and_gaps_are_no_motion():
    tracks = waved(1.0)
    gone = tracks.copy()
    gone[:, 1] = np.nan
    alone = np.array([0.4 / 0.6, 0.0, 0.2 / 0.6])
    for formula in (weight, time, flow):
        assert formula(gone, RATE, SHARES) == pytest.approx(formula(tracks, RATE, alone))
    assert space(gone, SHARES) == pytest.approx(space(tracks, alone))
    gap = tracks.copy()
    gap[100:140, 0] = np.nan
    assert time(gap, RATE, SHARES) == pytest.approx(time(tracks, RATE, SHARES), rel=0.2)


def moved(**by):
    """Hands left and right below the face, one second; `by` names the axis and the way of each hand along it."""
    tracks = np.tile(np.array([[-0.4, -1.0, -0.3], [0.4, -1.0, -0.3], [0.0, 0.0, 0.0]]), (31, 1, 1))
    for axis, (left, right) in by.items():
        tracks[:, 0, "xyz".index(axis)] += np.linspace(0, left, 31)
        tracks[:, 1, "xyz".index(axis)] += np.linspace(0, right, 31)
    return tracks


def test_shape_has_labans_signs():
    assert spreading(moved(x=(-0.5, 0.5)), 30) > 0.1
    assert spreading(moved(x=(0.3, -0.3)), 30) < -0.1
    assert rising(moved(y=(0.6, 0.6)), 30) == pytest.approx(0.6)
    assert rising(moved(y=(-0.6, 0.0)), 30) == pytest.approx(-0.3)
    assert advancing(moved(z=(-0.5, -0.5)), 30) == pytest.approx(0.5)
    assert advancing(moved(z=(0.2, 0.2)), 30) == pytest.approx(-0.2)


def test_the_triangle_is_half_base_by_height():
    assert triangle(moved())[0] == pytest.approx(0.8 * math.hypot(1.0, 0.3) / 2)


def test_a_polynomial_of_the_third_degree_is_its_own_smoothing():
    t = np.arange(40) / 30
    tracks = (2 - t + 3 * t**2 - 0.5 * t**3)[:, None, None] * np.ones((1, 2, 2))
    width = window_frames(30)
    place, velocity, acceleration, jerk = derivatives(tracks, 30)[:, :, 0, 0]
    mid = t[width // 2 : -(width // 2)]
    np.testing.assert_allclose(place, 2 - mid + 3 * mid**2 - 0.5 * mid**3, atol=1e-9)
    np.testing.assert_allclose(velocity, -1 + 6 * mid - 1.5 * mid**2, atol=1e-8)
    np.testing.assert_allclose(acceleration, 6 - 3 * mid, atol=1e-7)
    np.testing.assert_allclose(jerk, -3, atol=1e-5)


@pytest.mark.parametrize(("frames", "rate_hz"), [(5, 15.0), (7, 30.0), (13, 60.0)])
def test_the_coefficients_are_those_of_scipy(frames, rate_hz):
    savgol_coeffs = pytest.importorskip("scipy.signal").savgol_coeffs
    for order, row in enumerate(coefficients(frames, rate_hz)):
        wanted = savgol_coeffs(frames, DEGREE, deriv=order, delta=1 / rate_hz, use="dot")
        np.testing.assert_allclose(row, wanted, rtol=1e-7, atol=1e-9 * rate_hz**order)
