"""Resampling and retiming: by hand, and properties."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import BadInput
from observer.motion.archive import Recording, Span, check_recording, resample, retime


def line(frames, rate_hz=10.0, spans=(), unseen=()):
    """One part that moves one metre a frame along x, and one that stands; `unseen` frames of the first are NaN."""
    positions = np.zeros((frames, 2, 3), np.float32)
    positions[:, 0, 0] = np.arange(frames)
    positions[list(unseen), 0] = np.nan
    return Recording(positions, rate_hz, "walk", "3", "2", tuple(spans))


def x(recording):
    return recording.positions[:, 0, 0].tolist()


def test_a_lower_rate_keeps_the_first_frame():
    assert x(resample(line(5), 5.0)) == [0, 2, 4]
    assert x(resample(line(6), 5.0)) == [0, 2, 4]
    assert x(resample(line(5), 4.0)) == [0, 2.5]
    assert x(resample(line(5), 0.1)) == [0]


@pytest.mark.parametrize("factor", range(2, 60))
def test_rounding_never_hides_a_seen_frame(factor):
    finer = resample(line(12, rate_hz=0.7, unseen=range(1, 12, 2)), 0.7 * factor)
    assert len(finer.positions) == 11 * factor + 1
    assert np.isfinite(finer.positions[:: 2 * factor, 0]).all()


def test_a_faster_performance_takes_fewer_frames():
    fast = retime(line(18), 1.7)
    assert len(fast.positions) == 11 and fast.rate_hz == 10.0
    np.testing.assert_allclose(x(fast), 1.7 * np.arange(11), rtol=1e-6)
    assert x(retime(line(3), 0.5)) == [0, 0.5, 1, 1.5, 2]


@pytest.mark.parametrize("frames", [1, 2, 5])
def test_two_frames_always_remain(frames):
    assert x(retime(line(frames), 1000.0)) == [0, frames - 1]


def test_spans_are_resampled_too():
    spans = (Span(0, 4, "a"), Span(4, 9, "b"), Span(10, 12, "c"))
    assert retime(line(12, spans=spans), 2.0).spans == (Span(0, 2, "a"), Span(2, 5, "b"), Span(5, 6, "c"))
    assert resample(line(12, spans=spans), 20.0).spans == (Span(0, 8, "a"), Span(8, 18, "b"), Span(20, 23, "c"))


@pytest.mark.parametrize("number", [0.0, -1.0, float("nan"), float("inf")])
def test_only_positive_finite_numbers(number):
    with pytest.raises(BadInput, match="rate_hz"):
        resample(line(4), number)
    with pytest.raises(BadInput, match="tempo"):
        retime(line(4), number)


rates = st.floats(1.0, 100.0)
gaps = st.sets(st.integers(1, 11))


@given(frames=st.integers(2, 40), old=rates, new=rates)
def test_straight_motion_stays_straight_at_any_rate(frames, old, new):
    recording = resample(line(frames, old, spans=(Span(0, frames, "walk"),)), new)
    count = len(recording.positions)
    np.testing.assert_allclose(x(recording), np.arange(count) * old / new, atol=1e-4)
    assert (count - 1) / new <= (frames - 1) / old + 1e-4 < count / new + 2e-4
    assert recording.spans == (Span(0, count, "walk"),)


@given(tempo=st.floats(0.3, 3.0), gap=gaps, edges=st.lists(st.integers(0, 12), unique=True))
def test_retiming_gives_a_valid_recording_and_reveals_nothing(tempo, gap, edges):
    ordered = sorted(edges)
    spans = [Span(a, b, "s") for a, b in itertools.pairwise(ordered)]
    result = retime(line(12, spans=spans, unseen=gap), tempo)
    check_recording(result, 2, "result")
    assert len(result.positions) >= 2
    for frame, place in enumerate(result.positions[:, 0, 0]):
        instant = min(frame * tempo, 11)
        if 1e-7 < abs(instant - round(instant)) < 1e-5:
            continue  # so near to a frame that it may count as that frame or as being beside it
        around = {int(np.floor(instant + 1e-6)), int(np.ceil(instant - 1e-6))}
        assert np.isnan(place) == bool(around & gap)
