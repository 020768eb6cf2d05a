"""The assignment against every assignment there is."""

from itertools import permutations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from observer.tracking.kalman import assign, squared_distances


def total(cost, chosen, gate):
    return sum(gate if column is None else cost[row, column] for row, column in enumerate(chosen))


@given(st.integers(1, 3), st.integers(0, 4), st.data(), st.floats(0.1, 20))
def test_is_the_cheapest_of_all_and_none_beyond_the_gate(parts, candidates, data, gate):
    cost = data.draw(arrays(np.float64, (parts, candidates), elements=st.floats(0, 30)))
    chosen = assign(cost, gate)
    taken = [column for column in chosen if column is not None]
    assert len(taken) == len(set(taken))
    assert all(column is None or cost[row, column] <= gate for row, column in enumerate(chosen))
    slots = [*range(candidates), *[None] * parts]
    every = (c for c in permutations(slots, parts) if all(k is None or cost[r, k] <= gate for r, k in enumerate(c)))
    assert np.isclose(total(cost, chosen, gate), min(total(cost, c, gate) for c in every))


def test_distances_are_mahalanobis():
    spread = np.array([[4.0, 0.0], [0.0, 9.0]])
    found = squared_distances([(np.zeros(2), spread)], np.array([[2.0, 3.0], [0.0, 0.0]]))
    assert np.allclose(found, [[2.0, 0.0]])
