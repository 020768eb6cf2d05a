"""Frames at any times become instants at the model's rate."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common import SECOND_NS
from observer.runtime.pipeline import LONGEST_GAP_S, Resampler
from observer.tracks import Tracks


def at(seconds):
    """A part that moves in a straight line, and one that is never seen."""
    return Tracks(np.array([[3 * seconds, 7 - seconds], [np.nan, np.nan]]))


def resampled(rate_hz, times):
    resampler = Resampler(rate_hz)
    return [tracks for t in times for tracks in resampler.update(round(t * SECOND_NS), at(t))]


@given(st.floats(1, 120), st.integers(1, 60))
def test_a_camera_at_the_models_rate_keeps_its_own_frames(rate_hz, count):
    times = np.arange(count) / rate_hz
    instants = resampled(rate_hz, times)
    assert len(instants) == count
    assert np.allclose([i.centres[0] for i in instants], [at(t).centres[0] for t in times], atol=1e-6)


@given(st.floats(5, 60), st.lists(st.floats(0.001, 0.24), min_size=1, max_size=80))
def test_the_instants_are_the_models_whatever_the_camera_does(rate_hz, gaps):
    times = np.concatenate([[0.0], np.cumsum(gaps)])
    instants = resampled(rate_hz, times)
    assert abs(len(instants) - (times[-1] * rate_hz + 1)) <= 1
    expected = np.arange(len(instants)) / rate_hz
    assert np.allclose([i.centres[0, 0] for i in instants], 3 * expected, atol=1e-5)
    assert all(np.isnan(i.centres[1]).all() for i in instants)


def test_nothing_is_seen_in_a_gap_and_a_long_gap_is_cut_short():
    resampler = Resampler(10)
    resampler.update(0, at(0))
    late = resampler.update(SECOND_NS, at(1))
    assert [bool(i.visible[0]) for i in late] == [False] * 9 + [True]
    assert len(resampler.update(1000 * SECOND_NS, at(1000))) == LONGEST_GAP_S * 10
    assert len(resampler.update(round(1000.1 * SECOND_NS), at(1000.1))) == 1


def test_a_part_seen_in_one_of_two_frames_is_seen_near_that_one():
    resampler = Resampler(10)
    resampler.update(0, Tracks(np.full((1, 2), np.nan)))
    instants = resampler.update(2 * SECOND_NS // 10, Tracks(np.ones((1, 2))))
    assert [bool(i.visible[0]) for i in instants] == [False, True]


@pytest.mark.parametrize("back_s", [0.0, 5.0])
def test_a_clock_that_stands_or_is_set_back_loses_no_later_frame(back_s):
    resampler = Resampler(10)
    resampler.update(10 * SECOND_NS, at(10))
    resampler.update(round((10 - back_s) * SECOND_NS), at(10))
    assert len(resampler.update(round((10.1 - back_s) * SECOND_NS), at(10.1))) == 1
