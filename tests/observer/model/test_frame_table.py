"""The paper's model against a brute-force joint table (2), and against the phase filter, which contains it."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_phase_filter import PhaseFilter

from observer.model.chain_filter import Dynamics
from observer.model.symbol_tables import VECTOR_SYMBOLS, FrameClock, bin_indices, learn_table, log_evidence


def random_table(rng, movements, bins, parts):
    table = rng.dirichlet(np.full(VECTOR_SYMBOLS, 0.5), size=(movements, bins, parts)) + 1e-3
    return table / table.sum(-1, keepdims=True)


def test_counting_by_hand_with_dirichlet_smoothing():
    symbols = np.array([[1, 3], [1, -1], [0, 3], [-1, 3]], dtype=np.int8)
    table = np.exp(learn_table([(symbols, 0)], movements=1, bins=2, smoothing=0.5))
    assert table[0, 0, :, 1] == pytest.approx([(2 + 0.5) / (2 + 4.5), 0.5 / (1 + 4.5)])
    assert table[0, 1, 0, 0] == pytest.approx((1 + 0.5) / (1 + 4.5))  # NOT_SEEN was not counted
    assert table.sum(-1) == pytest.approx(np.ones((1, 2, 2)))


@given(frames=st.integers(1, 60), bins=st.integers(1, 40))
def test_the_clock_passes_through_all_bins(frames, bins):
    i = bin_indices(frames, bins)
    assert i[0] == 0 and (np.diff(i) >= 0).all() and i[-1] <= bins - 1
    if frames >= bins:
        assert set(i) == set(range(bins))


@given(seed=st.integers(0, 1000))
@settings(max_examples=20)
def test_the_update_equals_a_brute_force_joint_table(seed):
    """P(M | b_1:n) by writing down the joint distribution of (2) for every possible observation and conditioning."""
    rng = np.random.default_rng(seed)
    movements, bins, parts, letters = 2, 2, 2, 3
    table = rng.dirichlet(np.ones(letters), size=(movements, bins, parts))
    joint = {}
    for m in range(movements):
        for stream in itertools.product(range(letters), repeat=bins * parts):
            b = np.array(stream).reshape(bins, parts)
            joint[m, stream] = (
                1 / movements * np.prod([table[m, i, p, b[i, p]] for i in range(bins) for p in range(parts)])
            )
    assert sum(joint.values()) == pytest.approx(1)
    stream = tuple(rng.integers(letters, size=bins * parts))
    oracle = np.array([joint[m, stream] for m in range(movements)])
    clock = FrameClock(movements, bins, frames=bins)
    for symbols in np.array(stream, dtype=np.int8).reshape(bins, parts):
        clock.condition(log_evidence(np.log(table)[:, clock.i], symbols))
    assert clock.p == pytest.approx(oracle / oracle.sum())


@given(seed=st.integers(0, 1000), frames=st.integers(1, 12))
@settings(max_examples=30)
def test_the_phase_filter_with_one_speed_equals_the_frame_table(seed, frames):
    rng = np.random.default_rng(seed)
    movements, phases, parts = 4, 12, 3
    table = np.log(random_table(rng, movements, phases, parts))
    one_phase_a_frame = Dynamics(steps=np.array([0.0, 1.0]), entry=np.ones(1), begin=0.1, forget=0.1)
    belief = PhaseFilter(np.arange(movements), phases, np.full(movements, 1 / movements), one_phase_a_frame, True)
    clock = FrameClock(movements, phases, frames=phases)
    for symbols in rng.integers(-1, VECTOR_SYMBOLS, size=(frames, parts)).astype(np.int8):
        clock.condition(log_evidence(table[:, clock.i], symbols))
        belief.step(log_evidence(table, symbols), -50.0)
        assert belief.p == pytest.approx(clock.p, abs=1e-9)


def test_a_part_not_seen_is_factor_one():
    table = np.log(random_table(np.random.default_rng(1), 3, 1, 2))
    both, one = np.array([4, -1], dtype=np.int8), np.array([4], dtype=np.int8)
    assert log_evidence(table, both) == pytest.approx(log_evidence(table[..., :1, :], one))
    assert log_evidence(table, np.array([-1, -1], dtype=np.int8)) == pytest.approx(np.zeros((3, 1)))
