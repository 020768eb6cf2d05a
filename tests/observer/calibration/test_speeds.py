"""How fast corners move: known motions, and corners that come and go."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from observer.calibration.detection import speeds

IDS = np.arange(3)
BASE = np.array([[10.0, 20], [30, 20], [10, 40]])


@given(st.tuples(st.floats(-40, 40), st.floats(-40, 40)), st.integers(1, 5), st.integers(2, 6))
def test_an_even_motion_is_found_everywhere(way, step, count):
    shots = [(n * step, IDS, BASE + n * np.array(way)) for n in range(count)]
    for found in speeds(shots, step):
        np.testing.assert_allclose(found, np.tile(way, (3, 1)), atol=1e-9)


def test_a_corner_without_neighbours_moves_as_the_others_and_one_alone_stands():
    shots = [
        (0, IDS[:2], BASE[:2]),
        (1, IDS, BASE + np.array([4, 0])),
        (3, IDS, BASE + np.array([50, 0])),  # picture 2 does not show the board
    ]
    before, now, later = speeds(shots, 1)
    np.testing.assert_array_equal(before, [[4, 0], [4, 0]])
    np.testing.assert_array_equal(now, [[4, 0]] * 3)
    np.testing.assert_array_equal(later, np.zeros((3, 2)))
