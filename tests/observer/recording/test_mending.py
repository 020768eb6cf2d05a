"""Mending positions: what was wrong goes, what was right stays."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import BadInput
from observer.recording.reconstruction import (
    AXES,
    closed,
    moving_span,
    performer_axes,
    to_performer_axes,
    without_spikes,
)


def swing(rate_hz, seconds=2.0, hertz=1.5, reach=0.4):
    """A hand that swings about as fast as people wave: 3.8 m/s."""
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    x = reach * np.sin(2 * np.pi * hertz * t)
    return np.stack([x, 1 + 0 * x, 0 * x], axis=-1)[:, None]


@pytest.mark.parametrize("rate_hz", [10, 15, 30, 60])
def test_a_waving_hand_has_no_spikes(rate_hz):
    np.testing.assert_array_equal(without_spikes(swing(rate_hz), rate_hz), swing(rate_hz))


@pytest.mark.parametrize("length", [1, 2])
def test_a_hand_taken_for_the_other_is_a_spike(length):
    positions = swing(30)
    wrong = slice(20, 20 + length)
    positions[wrong] += [0.5, 0, 0.4]
    mended = without_spikes(positions, 30)
    assert np.isnan(mended[wrong]).all()
    assert np.isfinite(np.delete(mended, np.r_[wrong], axis=0)).all()


def test_a_part_that_is_alone_is_believed():
    positions = np.full((20, 1, 3), np.nan)
    positions[7] = 1.0
    np.testing.assert_array_equal(without_spikes(positions, 30), positions)


@given(st.lists(st.booleans(), min_size=1, max_size=40), st.floats(10, 60))
def test_only_short_gaps_are_closed_and_by_a_straight_line(seen, rate_hz):
    line = np.arange(len(seen))[:, None, None] * np.array([0.01, -0.02, 0.005])
    mended = closed(np.where(np.array(seen)[:, None, None], line, np.nan), rate_hz)
    for n, was_seen in enumerate(seen):
        before = next((k for k in range(n, -1, -1) if seen[k]), None)
        after = next((k for k in range(n, len(seen)) if seen[k]), None)
        bridged = None not in (before, after) and (after - before) / rate_hz <= 0.15 + 1e-9
        assert np.isfinite(mended[n]).all() == (was_seen or bridged)
        if was_seen or bridged:
            np.testing.assert_allclose(mended[n], line[n], atol=1e-12)


def test_idle_ends_are_cut_and_a_quarter_of_a_second_is_left():
    rng = np.random.default_rng(0)
    hand = np.concatenate([np.tile(swing(30)[:1], (60, 1, 1)), swing(30), np.tile(swing(30)[-1:], (45, 1, 1))])
    still = np.tile([[[0.1, 1.7, 0.0]]], (len(hand), 1, 1))
    positions = np.concatenate([hand, still], axis=1) + rng.normal(0, 0.008, (len(hand), 2, 3))
    begin, end = moving_span(positions, [0], 30)
    assert 60 - 12 <= begin <= 60 - 4
    assert 120 + 4 <= end <= 120 + 12
    assert moving_span(positions, [1], 30) == (0, len(positions))
    assert moving_span(positions[:3], [0], 30) == (0, 3)


def test_the_axes_of_calibrate_are_the_performers():
    np.testing.assert_array_equal(performer_axes("y", "-z"), np.eye(3))


def test_a_room_whose_z_is_up():
    # He faces along x, his right is then -y: x forward, y left, z up.
    np.testing.assert_array_equal(to_performer_axes(np.array([1.0, 2.0, 3.0]), "z", "x"), [-2, 3, -1])


@pytest.mark.parametrize("up", AXES)
@pytest.mark.parametrize("front", AXES)
def test_turning_neither_mirrors_nor_stretches(up, front):
    if up[-1] == front[-1]:
        with pytest.raises(BadInput, match="--front"):
            performer_axes(up, front)
        return
    R = performer_axes(up, front)
    np.testing.assert_array_equal(R @ R.T, np.eye(3))
    assert np.linalg.det(R) == pytest.approx(1)
    np.testing.assert_array_equal(R @ AXES[up], [0, 1, 0])
    np.testing.assert_array_equal(R @ AXES[front], [0, 0, -1])


def test_what_is_no_axis_is_told():
    with pytest.raises(BadInput, match="--up 'w'"):
        performer_axes("w", "-z")
