"""Resampling, spikes, gaps, trimming and axes of recorded positions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from observer_stage import rejected

from observer.geometry.projection import pinhole_matrix, project
from observer.prepared_tracks import at_even_rate
from observer.recording.new_recording import noise_m, smoothed
from observer.recording.person_placement import _facing
from observer.recording.reconstruction import (
    SAME_S,
    UP_AXES,
    CameraTracks,
    common_instants,
    fill_gaps,
    moving_span,
    performer_axes,
    remove_spikes,
    resample_tracks,
)
from observer.recording.triangulation import exchanged_back, px_per_m, reconstruct

MATRIX = np.eye(3, 4)
EPOCH_NS = 1_764_000_000_123_456_789


def tracks(times_s, centres=None, begin_ns=0, name="cam"):
    at = begin_ns + np.round(np.array(times_s) * 1e9).astype(np.int64)
    centres = np.zeros((len(at), 1, 2)) if centres is None else np.array(centres, dtype=float).reshape(len(at), 1, 2)
    return CameraTracks(name, MATRIX, at, centres)


@given(
    st.floats(-50, 50),
    st.floats(-900, 900),
    st.lists(st.floats(0.01, 0.19), min_size=2, max_size=30),
    st.floats(5, 120),
    st.sampled_from([0, EPOCH_NS]),
)
def test_a_straight_line_is_exact_at_any_rate_and_epoch(at, speed, steps, rate_hz, begin_ns):
    times = np.concatenate([[0], np.cumsum(steps)])
    camera = tracks(times, np.column_stack([at + speed * times, -speed * times]), begin_ns)
    wanted = common_instants([camera, camera], rate_hz)
    centres_at = resample_tracks(camera, wanted)[:, 0]
    seconds = (wanted - begin_ns) / 1e9
    # An instant within SAME_S of an observation takes its value; the hand moves this far in that time.
    tolerance = abs(speed) * SAME_S + 1e-6
    np.testing.assert_allclose(centres_at, np.column_stack([at + speed * seconds, -speed * seconds]), atol=tolerance)
    assert len(wanted) == int(times[-1] * rate_hz + 1e-6) + 1


def test_long_gaps_stay_unknown():
    times = np.arange(20) / 20
    positions = np.column_stack([times, times])
    positions[[4, 5]] = np.nan  # 0.15 s between 3 and 6
    positions[9:14] = np.nan  # 0.3 s between 8 and 14
    centres_at = resample_tracks(tracks(times, positions), np.round(np.arange(39) / 40 * 1e9).astype(np.int64))[:, 0, 0]
    unknown = np.flatnonzero(np.isnan(centres_at))
    np.testing.assert_array_equal(unknown, np.arange(17, 28))
    known = np.isfinite(centres_at)
    np.testing.assert_allclose(centres_at[known], (np.arange(39) / 40)[known], atol=1e-9)


def test_nothing_is_extrapolated():
    camera = tracks([0.3, 0.4, 0.5], [[1, 1], [2, 2], [3, 3]])
    centres_at = resample_tracks(camera, np.round(np.arange(0, 10) * 1e8).astype(np.int64))[:, 0, 0]
    np.testing.assert_allclose(centres_at[[3, 4, 5]], [1, 2, 3])
    assert np.isnan(np.delete(centres_at, [3, 4, 5])).all()
    assert np.isnan(resample_tracks(tracks([0.1], [[np.nan, 1]]), np.array([0, 10**8]))).all()


def test_the_common_time_has_at_least_two_cameras():
    cameras = [tracks([0, 10]), tracks([2, 7]), tracks([3, 5])]
    at = common_instants(cameras, 10)
    assert at[0] == 2_000_000_000 and at[-1] == 7_000_000_000
    assert np.unique(np.diff(at)).tolist() == [100_000_000]


def test_cameras_without_common_time_are_rejected():
    with rejected("do not mix them"):
        common_instants([tracks([0, 5]), tracks([0, 5], begin_ns=EPOCH_NS)], 30)
    with rejected("no pictures from door"):
        common_instants([tracks([0, 5]), tracks([], name="door")], 30)


def swing(rate_hz, seconds=2.0, hertz=1.5, reach=0.4):
    """A hand that swings about as fast as people wave: 3.8 m/s."""
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    x = reach * np.sin(2 * np.pi * hertz * t)
    return np.stack([x, 1 + 0 * x, 0 * x], axis=-1)[:, None]


@pytest.mark.parametrize("rate_hz", [10, 15, 30, 60])
def test_a_waving_hand_has_no_spikes(rate_hz):
    np.testing.assert_array_equal(remove_spikes(swing(rate_hz), rate_hz), swing(rate_hz))


@pytest.mark.parametrize("length", [1, 2])
def test_a_swapped_hand_is_a_spike(length):
    positions = swing(30)
    wrong = slice(20, 20 + length)
    positions[wrong] += [0.5, 0, 0.4]
    repaired = remove_spikes(positions, 30)
    assert np.isnan(repaired[wrong]).all()
    assert np.isfinite(np.delete(repaired, np.r_[wrong], axis=0)).all()


def test_an_isolated_position_is_kept():
    positions = np.full((20, 1, 3), np.nan)
    positions[7] = 1.0
    np.testing.assert_array_equal(remove_spikes(positions, 30), positions)


@given(st.lists(st.booleans(), min_size=1, max_size=40), st.floats(10, 60))
def test_only_short_gaps_are_filled(known, rate_hz):
    line = np.arange(len(known))[:, None, None] * np.array([0.01, -0.02, 0.005])
    repaired = fill_gaps(np.where(np.array(known)[:, None, None], line, np.nan), rate_hz)
    for n, was_known in enumerate(known):
        before = next((k for k in range(n, -1, -1) if known[k]), None)
        after = next((k for k in range(n, len(known)) if known[k]), None)
        bridged = None not in (before, after) and (after - before) / rate_hz <= 0.15 + 1e-9
        assert np.isfinite(repaired[n]).all() == (was_known or bridged)
        if was_known or bridged:
            np.testing.assert_allclose(repaired[n], line[n], atol=1e-12)


def test_idle_ends_are_cut_except_for_a_margin():
    rng = np.random.default_rng(0)
    hand = np.concatenate([np.tile(swing(30)[:1], (60, 1, 1)), swing(30), np.tile(swing(30)[-1:], (45, 1, 1))])
    still = np.tile([[[0.1, 1.7, 0.0]]], (len(hand), 1, 1))
    positions = np.concatenate([hand, still], axis=1) + rng.normal(0, 0.008, (len(hand), 2, 3))
    begin, end = moving_span(positions, [0], 30)
    assert 60 - 12 <= begin <= 60 - 4
    assert 120 + 4 <= end <= 120 + 12
    assert moving_span(positions, [1], 30) == (0, len(positions))
    assert moving_span(positions[:3], [0], 30) == (0, 3)


@pytest.mark.parametrize("up", UP_AXES)
@pytest.mark.parametrize("front", UP_AXES)
def test_the_axes_form_a_rotation(up, front):
    if up[-1] == front[-1]:
        with rejected("--front"):
            performer_axes(up, front)
        return
    R = performer_axes(up, front)
    np.testing.assert_array_equal(R @ R.T, np.eye(3))
    assert np.linalg.det(R) == pytest.approx(1)
    np.testing.assert_array_equal(R @ UP_AXES[up], [0, 1, 0])
    np.testing.assert_array_equal(R @ UP_AXES[front], [0, 0, -1])


def test_a_metre_is_as_many_pixels_as_across_the_optical_axis_on_average_over_the_cameras():
    """900 px of focal length at 4 m and at 2 m."""
    near, far = (pinhole_matrix(yaw, 0.0, distance, 900, (640, 360)) for yaw, distance in ((0.3, 2.0), (1.2, 4.0)))
    assert px_per_m([far], np.zeros((1, 1, 3)))[0, 0] == pytest.approx(900 / 4, rel=0.01)
    assert px_per_m([near, far], np.zeros((1, 1, 3)))[0, 0] == pytest.approx((900 / 2 + 900 / 4) / 2, rel=0.01)


@pytest.mark.parametrize("cameras", [2, 4])
def test_the_noise_of_a_track_is_that_of_one_camera_in_metres(cameras):
    """The residuals of a point in n cameras have 2n - 3 degrees of freedom; the median of many instants is taken."""
    from scipy.stats import chi2  # it takes half a second, in each worker that reads this file

    matrices = [pinhole_matrix(yaw, 0.1, 3.0, 900, (640, 360)) for yaw in (-0.8, 0.5, 1.6, 2.9)[:cameras]]
    rng, freedom = np.random.default_rng(0), 2 * cameras - 3
    centres = np.stack([project(H, np.zeros((800, 1, 3))) for H in matrices], axis=2)
    result = reconstruct(matrices, centres + rng.normal(0, 2.0, centres.shape))
    expected = 2.0 * np.sqrt(chi2.median(freedom) / freedom) / px_per_m(matrices, np.zeros((1, 1, 3)))[0, 0]
    assert noise_m(matrices, result) == pytest.approx([expected], rel=0.06)


@pytest.mark.parametrize(("apart", "is_exchanged"), [(0.6, False), (0.8, True), (3.0, True)])
def test_a_pair_is_put_right_only_where_the_gate_shows_that_it_was_exchanged(apart, is_exchanged):
    """The squared distances, each at most the gate's, must shrink by more than the gate's: 2 d² > gate²."""
    gate_px = 20.0
    side = apart * gate_px / 900 * 3.0 / 2
    positions = np.array([[[-side, 0.0, 0.0], [side, 0.0, 0.0]]])
    matrices = [pinhole_matrix(0.0, 0.0, 3.0, 900, (640, 360))] * 2
    centres = np.stack([project(H, positions) for H in matrices], axis=2)
    centres[:, :, 1] = centres[:, ::-1, 1]
    mended, counts = exchanged_back(matrices, centres, positions, [(0, 1)], gate_px)
    assert counts.tolist() == [0, int(is_exchanged)]
    np.testing.assert_array_equal(mended[:, :, 1], centres[:, ::-1, 1] if is_exchanged else centres[:, :, 1])


def test_positions_are_smoothed_over_a_tenth_of_a_second_on_either_side():
    from scipy.signal import savgol_filter

    rng = np.random.default_rng(0)
    positions = np.cumsum(rng.normal(0, 0.02, (60, 2, 3)), axis=0)
    result = smoothed(positions, 60.0, np.array([0.01, 0.0]))
    np.testing.assert_allclose(result[:, 0], savgol_filter(positions[:, 0], 13, 2, axis=0))
    np.testing.assert_array_equal(result[:, 1], positions[:, 1])
    np.testing.assert_array_equal(smoothed(positions, 15.0, np.array([0.01, 0.01])), positions)


@pytest.mark.parametrize("spread", [0.05, 0.6])
def test_the_facing_is_the_circular_mean_and_its_spread_the_circular_deviation(spread):
    """Also across 180 degrees, and whatever the lengths of the lines."""
    from scipy.stats import circmean, circstd

    rng = np.random.default_rng(0)
    angles = np.pi + rng.normal(0, spread, 200)
    lines = rng.uniform(0.2, 3.0, (200, 1)) * np.stack([np.cos(angles), 0 * angles, -np.sin(angles)], axis=1)
    mean, deviation = _facing(lines)
    assert mean % 360 == pytest.approx(np.degrees(circmean(angles)) % 360)
    assert deviation == pytest.approx(np.degrees(circstd(angles)))


@pytest.mark.parametrize("rate_hz", [15.0, 29.97, 30.0, 60.0])
def test_an_even_rate_has_the_last_instant_although_times_are_rounded_to_nanoseconds(rate_hz):
    at_ns = EPOCH_NS + np.round(np.arange(100) * 1e9 / rate_hz).astype(np.int64)
    for count in range(2, 101):
        assert len(at_even_rate(at_ns[:count], np.zeros((count, 1, 2)), rate_hz)) == count
