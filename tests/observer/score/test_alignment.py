"""The alignment of two performances: a brute-force oracle and what must not matter."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.score.comparison import Alignment

LENGTHS = st.integers(2, 7)


def places(frames, seed, parts=2):
    return np.random.default_rng(seed).normal(size=(frames, parts, 2)).astype(np.float32)


def oracle(one, other):
    """The least mean distance over all paths, and the sums, by the plain recursion."""
    d = np.array([[np.sqrt(((a - b) ** 2).mean()) for b in other] for a in one])
    sums = np.full(d.shape, np.inf)
    for i in range(len(one)):
        for j in range(len(other)):
            before = [d[0, 0] if i == j == 0 else np.inf]
            before += [sums[i - 1, j] + d[i, j]] if i else []
            before += [sums[i, j - 1] + d[i, j]] if j else []
            before += [sums[i - 1, j - 1] + 2 * d[i, j]] if i and j else []
            sums[i, j] = min(before)
    return sums[-1, -1] / (len(one) + len(other))


@settings(max_examples=40, deadline=None)
@given(frames=LENGTHS, lengths=st.lists(LENGTHS, min_size=1, max_size=4), seed=st.integers(0, 999))
def test_distances_are_those_of_the_plain_recursion(frames, lengths, seed):
    own, takes = places(frames, seed), [places(length, seed + 1 + n) for n, length in enumerate(lengths)]
    found = Alignment(own, takes).distances
    assert found == pytest.approx([oracle(own, take) for take in takes], abs=2e-3)


@settings(max_examples=40, deadline=None)
@given(frames=LENGTHS, length=LENGTHS, seed=st.integers(0, 999))
def test_a_path_goes_from_the_first_to_the_last_frames_step_by_step(frames, length, seed):
    path = Alignment(places(frames, seed), [places(length, seed + 1)]).path(0)
    assert path[0].tolist() == [0, 0] and path[-1].tolist() == [frames - 1, length - 1]
    steps = np.diff(path, axis=0)
    assert ((steps >= 0) & (steps <= 1)).all() and (steps.sum(axis=1) >= 1).all()


def test_the_same_at_half_the_tempo_is_hardly_apart():
    own = places(20, 0)
    alignment = Alignment(own, [np.repeat(own, 2, axis=0), own])
    assert alignment.distances == pytest.approx([0, 0], abs=1e-3)
    assert alignment.path(1).tolist() == [[n, n] for n in range(20)]
