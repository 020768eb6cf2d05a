"""Metrics against brute force: plain loops over trials."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from studies.metrics import BINS, LEAST_P, accuracy, brier, confusion, expected_calibration_error, log_loss


@st.composite
def judged(draw):
    n, m = draw(st.integers(1, 30)), draw(st.integers(2, 5))
    rows = draw(
        st.lists(st.lists(st.sampled_from([0.0, 0.1, 0.3, 1.0, 7.0]), min_size=m, max_size=m), min_size=n, max_size=n)
    )
    p = np.array([[x / sum(row) for x in row] if sum(row) else [1 / m] * m for row in rows])
    return p, np.array(draw(st.lists(st.integers(0, m - 1), min_size=n, max_size=n)))


def map_of(row):
    return max(range(len(row)), key=lambda m: row[m])


@given(judged())
def test_accuracy_and_confusion(case):
    p, truth = case
    right = [map_of(row) == t for row, t in zip(p, truth, strict=True)]
    assert accuracy(p, truth) == pytest.approx(sum(right) / len(right))
    counts = [[sum(t == i and map_of(row) == j for row, t in zip(p, truth, strict=True)) for j in range(p.shape[1])]
              for i in range(p.shape[1])]  # fmt: skip
    assert confusion(p, truth).tolist() == counts
    assert np.trace(confusion(p, truth)) == sum(right)


@given(judged())
def test_brier(case):
    p, truth = case
    each = [sum((x - (m == t)) ** 2 for m, x in enumerate(row)) for row, t in zip(p, truth, strict=True)]
    assert brier(p, truth) == pytest.approx(sum(each) / len(each))
    assert 0 <= brier(p, truth) <= 2 + 1e-9


@given(judged())
def test_log_loss(case):
    p, truth = case
    each = [-math.log(max(row[t], LEAST_P)) for row, t in zip(p, truth, strict=True)]
    assert log_loss(p, truth) == pytest.approx(sum(each) / len(each), abs=1e-12)


@given(judged())
def test_expected_calibration_error(case):
    p, truth = case
    bins = [[] for _ in range(BINS)]
    for row, t in zip(p, truth, strict=True):
        confidence = max(row)
        bins[min(int(confidence * BINS), BINS - 1)].append((confidence, map_of(row) == t))
    expected = sum(
        len(b) / len(p) * abs(sum(right for _, right in b) / len(b) - sum(c for c, _ in b) / len(b)) for b in bins if b
    )
    assert expected_calibration_error(p, truth) == pytest.approx(expected, abs=1e-12)


def test_the_ends_of_the_scales():
    sure, right, wrong = np.eye(3), np.arange(3), np.array([1, 2, 0])
    for metric in (brier, log_loss, expected_calibration_error):
        assert metric(sure, right) == pytest.approx(0)
    assert brier(sure, wrong) == 2
    assert log_loss(sure, wrong) == pytest.approx(-math.log(1e-12))
    assert expected_calibration_error(sure, wrong) == 1
    unsure = np.full((4, 4), 0.25)
    assert brier(unsure, np.arange(4)) == pytest.approx(0.75)
    assert log_loss(unsure, np.arange(4)) == pytest.approx(math.log(4))
    assert expected_calibration_error(unsure, np.arange(4)) == pytest.approx(0)


def test_confidence_equal_to_accuracy_is_calibrated():
    p = np.array([[0.7, 0.3]] * 10)
    truth = np.array([0] * 7 + [1] * 3)
    assert expected_calibration_error(p, truth) == pytest.approx(0)
    assert expected_calibration_error(p, 1 - truth) == pytest.approx(0.4)


def test_one_bin_hides_what_many_show():
    p = np.array([[0.6, 0.4]] * 5 + [[1.0, 0.0]] * 5)
    truth = np.array([0] * 5 + [0, 0, 0, 1, 1])
    assert expected_calibration_error(p, truth, bins=1) == pytest.approx(0)
    assert expected_calibration_error(p, truth) == pytest.approx(0.4)
