"""One clock for several cameras: known curves, gaps, and who began when."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import BadInput
from observer.recording.reconstruction import SAME_S, CameraTracks, instants, sampled

H = np.eye(3, 4)
EPOCH_NS = 1_764_000_000_123_456_789


def sighted(times_s, centres=None, begin_ns=0, name="cam"):
    at = begin_ns + np.round(np.array(times_s) * 1e9).astype(np.int64)
    centres = np.zeros((len(at), 1, 2)) if centres is None else np.array(centres, dtype=float).reshape(len(at), 1, 2)
    return CameraTracks(name, H, at, centres)


@given(
    st.floats(-50, 50),
    st.floats(-900, 900),
    st.lists(st.floats(0.01, 0.19), min_size=2, max_size=30),
    st.floats(5, 120),
    st.sampled_from([0, EPOCH_NS]),
)
def test_a_straight_line_is_followed_exactly_at_any_rates_and_epochs(at, speed, steps, rate_hz, begin_ns):
    times = np.concatenate([[0], np.cumsum(steps)])
    one = sighted(times, np.column_stack([at + speed * times, -speed * times]), begin_ns)
    wanted = instants([one, one], rate_hz)
    found = sampled(one, wanted)[:, 0]
    seconds = (wanted - begin_ns) / 1e9
    # Instants nearer than SAME_S to a sighting take its place, so that is how far the hand may have gone meanwhile.
    wrong = abs(speed) * SAME_S + 1e-6
    np.testing.assert_allclose(found, np.column_stack([at + speed * seconds, -speed * seconds]), atol=wrong)
    assert len(wanted) == int(times[-1] * rate_hz + 1e-6) + 1


def test_what_is_not_seen_for_long_is_not_known_between():
    times = np.arange(20) / 20
    seen = np.column_stack([times, times])
    seen[[4, 5]] = np.nan  # 0.15 s between 3 and 6
    seen[9:14] = np.nan  # 0.3 s between 8 and 14
    found = sampled(sighted(times, seen), np.round(np.arange(39) / 40 * 1e9).astype(np.int64))[:, 0, 0]
    unknown = np.flatnonzero(np.isnan(found))
    np.testing.assert_array_equal(unknown, np.arange(17, 28))
    known = np.isfinite(found)
    np.testing.assert_allclose(found[known], (np.arange(39) / 40)[known], atol=1e-9)


def test_before_and_after_nothing_is_made_up():
    one = sighted([0.3, 0.4, 0.5], [[1, 1], [2, 2], [3, 3]])
    found = sampled(one, np.round(np.arange(0, 10) * 1e8).astype(np.int64))[:, 0, 0]
    np.testing.assert_allclose(found[[3, 4, 5]], [1, 2, 3])
    assert np.isnan(np.delete(found, [3, 4, 5])).all()
    assert np.isnan(sampled(sighted([0.1], [[np.nan, 1]]), np.array([0, 10**8]))).all()


def test_the_common_time_is_when_two_at_least_look():
    cameras = [sighted([0, 10]), sighted([2, 7]), sighted([3, 5])]
    at = instants(cameras, 10)
    assert at[0] == 2_000_000_000 and at[-1] == 7_000_000_000
    assert np.unique(np.diff(at)).tolist() == [100_000_000]


def test_no_common_time_is_told():
    with pytest.raises(BadInput, match="mix none"):
        instants([sighted([0, 5]), sighted([0, 5], begin_ns=EPOCH_NS)], 30)
    with pytest.raises(BadInput, match="no pictures from door"):
        instants([sighted([0, 5]), sighted([], name="door")], 30)
