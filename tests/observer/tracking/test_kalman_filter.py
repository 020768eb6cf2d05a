"""The filter of one part against the textbook's matrices."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from observer.tracking.kalman import ConstantVelocityFilter

number = st.floats(-300, 300)
steps = st.lists(st.tuples(st.floats(0, 0.5), number, number), min_size=1, max_size=12)


@given(steps, st.floats(1, 2000), st.floats(0.5, 20))
def test_equals_the_textbook_filter_written_with_full_matrices(steps, acceleration, noise):
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
        assert np.allclose(kf.spread, H @ P @ H.T + R, rtol=1e-6)
        x, P = x + K @ (np.array([u, v]) - H @ x), (np.eye(4) - K @ H) @ P
        kf.correct(np.array([u, v]))
        assert np.allclose(kf.state, x, rtol=1e-5, atol=1e-5)
        assert np.allclose(kf.covariance, P, rtol=1e-5, atol=1e-6 * P.max())


def test_a_steady_motion_is_predicted():
    kf = ConstantVelocityFilter(np.zeros(2), 10.0, 1.0)
    for i in range(1, 60):
        kf.predict(0.1)
        kf.correct(np.array([5.0 * i, -3.0 * i]))
    kf.predict(0.1)
    assert np.allclose(kf.centre, [300, -180], atol=0.5)
