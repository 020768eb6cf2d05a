"""Kalman filter, gating and assignment of one body part."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from observer.tracking.kalman import COAST_S, ConstantVelocityFilter, TrackedPart, assign
from observer.tracks import State

number = st.floats(-300, 300)
steps = st.lists(st.tuples(st.floats(0, 0.5), number, number), min_size=1, max_size=12)


@given(steps, st.floats(1, 2000), st.floats(0.5, 20))
def test_equals_the_filter_in_full_matrix_form(steps, acceleration, noise):
    kf = ConstantVelocityFilter(np.zeros(2), acceleration, noise)
    x, P = np.zeros(4), np.diag([noise**2, noise**2, (acceleration / 10) ** 2, (acceleration / 10) ** 2])
    for dt, u, v in steps:
        F = np.array([[1, 0, dt, 0], [0, 1, 0, dt], [0, 0, 1, 0], [0, 0, 0, 1]])
        q = acceleration**2 * np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]])
        Q = np.kron(q, np.eye(2))
        x, P = F @ x, F @ P @ F.T + Q
        H, R = np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0]]), noise**2 * np.eye(2)
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        kf.predict(dt)
        assert np.allclose(kf.variance * np.eye(2), H @ P @ H.T + R, rtol=1e-6)
        x, P = x + K @ (np.array([u, v]) - H @ x), (np.eye(4) - K @ H) @ P
        kf.correct(np.array([u, v]))
        assert np.allclose([*kf.centre, *kf.velocity], x, rtol=1e-5, atol=1e-5)
        covariance = np.kron([[kf._p, kf._c], [kf._c, kf._q]], np.eye(2))
        assert np.allclose(covariance, P, rtol=1e-5, atol=1e-6 * P.max())


def total(cost, columns, gate):
    return sum(gate if column is None else cost[row, column] for row, column in enumerate(columns))


@given(st.integers(1, 3), st.integers(0, 4), st.data(), st.floats(0.1, 20))
def test_the_assignment_is_optimal_and_none_is_beyond_the_gate(parts, candidates, data, gate):
    cost = data.draw(arrays(np.float64, (parts, candidates), elements=st.floats(0, 30)))
    columns = assign(cost, gate)
    used = [column for column in columns if column is not None]
    assert len(used) == len(set(used))
    assert all(column is None or cost[row, column] <= gate for row, column in enumerate(columns))
    slots = [*range(candidates), *[None] * parts]
    every = (c for c in permutations(slots, parts) if all(k is None or cost[r, k] <= gate for r, k in enumerate(c)))
    assert np.isclose(total(cost, columns, gate), min(total(cost, c, gate) for c in every))


@pytest.fixture
def part():
    part = TrackedPart(10.0)
    part.acquire(np.zeros(2), 100.0, 40.0)
    return part


@pytest.mark.parametrize(("area", "fits"), [(49, False), (51, True), (199, True), (201, False)])
def test_areas_fit_from_half_to_twice_the_median(part, area, fits):
    assert part.fits(area) is fits


def test_a_part_without_measurements_is_unsure_and_then_missing(part):
    part.not_measured(COAST_S * 0.9)
    assert part.state is State.UNSURE
    part.not_measured(COAST_S * 0.2)
    assert part.state is State.MISSING
    assert part.filter is None
