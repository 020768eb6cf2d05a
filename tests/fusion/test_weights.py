"""Weights against hand-computed values, and what every weighing must keep."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from fusion.engine import weights as weigh

WEIGHINGS = [
    weigh.inverse_entropy,
    weigh.inverse_entropy_static_threshold,
    weigh.inverse_entropy_average_threshold,
    weigh.minimum_entropy,
    weigh.equal,
]
entropies = arrays(np.float64, st.integers(1, 6), elements=st.floats(0, 5))


def test_inverse_entropy_by_hand():
    assert weigh.inverse_entropy(np.array([0.5, 1.0, 2.0])) == pytest.approx([4 / 7, 2 / 7, 1 / 7])


def test_static_threshold_silences_above_one_bit():
    assert weigh.inverse_entropy_static_threshold(np.array([0.5, 1.0, 2.0])) == pytest.approx(
        [2 / 3, 1 / 3, 0], abs=1e-4
    )


def test_average_threshold_silences_above_the_mean():
    assert weigh.inverse_entropy_average_threshold(np.array([1.0, 2.0, 3.3])) == pytest.approx(
        [2 / 3, 1 / 3, 0], abs=1e-4
    )


def test_minimum_entropy_shares_a_tie():
    assert weigh.minimum_entropy(np.array([0.3, 0.3, 0.4])) == pytest.approx([0.5, 0.5, 0])


def test_a_one_hot_judge_does_not_weigh_infinitely():
    assert np.isfinite(weigh.inverse_entropy(np.array([0.0, 1.0]))).all()


def test_negative_zero_is_not_an_entropy_and_does_no_harm():
    assert weigh.inverse_entropy(np.array([-0.0, 0.0])) == pytest.approx([0.5, 0.5])


@pytest.mark.parametrize("weighing", WEIGHINGS)
@given(h=entropies)
def test_weights_sum_to_one_and_the_surer_never_counts_less(weighing, h):
    w = weighing(h)
    assert w.sum() == pytest.approx(1) and (w >= 0).all()
    order = np.argsort(h)
    assert (np.diff(w[order]) <= 1e-12).all()


@given(h=entropies, most=st.floats(0.05, 1))
def test_capped_weights_sum_to_one_and_stay_below_the_cap(h, most):
    w = weigh.capped(weigh.inverse_entropy(h), most)
    assert w.sum() == pytest.approx(1)
    assert (w <= max(most, 1 / len(w)) + 1e-9).all()


def test_capping_by_hand_gives_the_rest_to_the_others_in_proportion():
    assert weigh.capped(np.array([0.7, 0.2, 0.1]), 0.4) == pytest.approx([0.4, 0.4, 0.2])
