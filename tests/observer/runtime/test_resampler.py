"""Frames at any times become instants at the model's rate."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.runtime.pipeline import BLIND_S, Resampler
from observer.tracks import Tracks

SECOND_NS = 1_000_000_000


def at(seconds):
    """A part that moves in a straight line, and one that is never seen."""
    return Tracks(np.array([[3 * seconds, 7 - seconds], [np.nan, np.nan]]))


def instants(rate_hz, times):
    pace = Resampler(rate_hz)
    return [tracks for t in times for tracks in pace.update(round(t * SECOND_NS), at(t))]


@given(st.floats(1, 120), st.integers(1, 60))
def test_a_camera_at_the_models_rate_gives_its_own_frames(rate_hz, count):
    times = np.arange(count) / rate_hz
    found = instants(rate_hz, times)
    assert len(found) == count
    assert np.allclose([f.centres[0] for f in found], [at(t).centres[0] for t in times], atol=1e-6)


@given(st.floats(5, 60), st.lists(st.floats(0.001, 0.24), min_size=1, max_size=80))
def test_whatever_the_camera_does_the_instants_are_those_of_the_model(rate_hz, gaps):
    times = np.concatenate([[0.0], np.cumsum(gaps)])
    found = instants(rate_hz, times)
    assert abs(len(found) - (times[-1] * rate_hz + 1)) <= 1
    expected = np.arange(len(found)) / rate_hz
    assert np.allclose([f.centres[0, 0] for f in found], 3 * expected, atol=1e-5)
    assert all(np.isnan(f.centres[1]).all() for f in found)


def test_a_gap_is_blind_and_does_not_last_for_ever():
    pace = Resampler(10)
    pace.update(0, at(0))
    late = pace.update(SECOND_NS, at(1))
    assert [bool(f.visible[0]) for f in late] == [False] * 9 + [True]
    assert len(pace.update(1000 * SECOND_NS, at(1000))) == BLIND_S * 10
    assert len(pace.update(round(1000.1 * SECOND_NS), at(1000.1))) == 1


def test_a_part_seen_in_one_of_two_frames_is_seen_where_that_one_is_nearer():
    pace = Resampler(10)
    pace.update(0, Tracks(np.full((1, 2), np.nan)))
    found = pace.update(2 * SECOND_NS // 10, Tracks(np.ones((1, 2))))
    assert [bool(f.visible[0]) for f in found] == [False, True]


@pytest.mark.parametrize("back_s", [0.0, 5.0])
def test_a_clock_that_stands_or_is_set_back_loses_nothing_afterwards(back_s):
    pace = Resampler(10)
    pace.update(10 * SECOND_NS, at(10))
    pace.update(round((10 - back_s) * SECOND_NS), at(10))
    assert len(pace.update(round((10.1 - back_s) * SECOND_NS), at(10.1))) == 1
