"""Each rule against a brute-force oracle, and the properties its docstring claims."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from common.probability import entropy_bits, normalise, uniform
from fusion.engine.rules import ROBUSTNESS, RULES


def pool(name, p, prior=None):
    p = np.asarray(p, dtype=float)
    return RULES[name].pool(p, uniform(p.shape[1]) if prior is None else np.asarray(prior, dtype=float)).p


positive = st.tuples(st.integers(1, 4), st.integers(2, 5)).flatmap(
    lambda s: arrays(np.float64, s, elements=st.floats(0.01, 1)).map(normalise)
)


def test_the_papers_rule_by_hand():
    # H = (.5, 1) bits -> weights 2/3, 1/3
    half_bit = 0.11002786443835955
    p = np.array([[1 - half_bit, half_bit], [0.5, 0.5]])
    assert entropy_bits(p) == pytest.approx([0.5, 1])
    assert pool("inverse_entropy", p)[0] == pytest.approx((2 * (1 - half_bit) + 0.5) / 3)


def test_inverse_entropy_is_not_monotone():
    # Raising one judge's belief in a movement can lower the fused belief in it: a known price of the rule.
    other = [0.9, 0.1, 0.0]
    before = pool("inverse_entropy", [[0.2, 0.1, 0.7], other])[0]
    after = pool("inverse_entropy", [[0.3, 0.0, 0.7], other])[0]
    assert before == pytest.approx(0.698, abs=5e-4)
    assert after == pytest.approx(0.692, abs=5e-4)


@pytest.mark.parametrize("name", ["linear", "inverse_entropy", "iest", "ieat", "min_entropy"])
@given(p=positive)
def test_linear_pools_stay_between_their_inputs(name, p):
    pooled = pool(name, p)
    assert (pooled >= p.min(0) - 1e-12).all() and (pooled <= p.max(0) + 1e-12).all()


@given(p=positive, q=st.integers(0, 9))
def test_product_is_bayes_rule_for_independent_judges(p, q):
    prior = normalise(np.arange(1.0, p.shape[1] + 1))
    oracle = np.array([prior[m] * np.prod([p[i, m] / prior[m] for i in range(len(p))]) for m in range(p.shape[1])])
    assert pool("product", p, prior) == pytest.approx(oracle / oracle.sum())


@pytest.mark.parametrize("name", ["product", "robust_product"])
@given(p=positive)
def test_a_judge_at_the_prior_is_neutral(name, p):
    prior = normalise(np.arange(1.0, p.shape[1] + 1))
    assert pool(name, np.vstack([p, prior]), prior) == pytest.approx(pool(name, p, prior))


@given(p=positive)
def test_the_log_pool_is_idempotent(p):
    same = np.repeat(p[:1], 3, axis=0)
    assert pool("log", same) == pytest.approx(p[0])


@given(p=positive, seed=st.integers(0, 99))
def test_the_log_pool_is_externally_bayesian(p, seed):
    # Updating every judge by a shared likelihood, or the pooled opinion alone, comes to the same.
    likelihood = np.random.default_rng(seed).uniform(0.1, 1, p.shape[1])
    assert pool("log", normalise(p * likelihood)) == pytest.approx(normalise(pool("log", p) * likelihood))


@given(p=arrays(np.float64, (2, 3), elements=st.floats(0.01, 1)).map(normalise))
def test_chernoff_minimises_the_overlap(p):
    a = np.linspace(0, 1, 2001)[:, None]
    overlaps = (p[0] ** a * p[1] ** (1 - a)).sum(1)
    best = a[overlaps.argmin(), 0]
    oracle = normalise(p[0] ** best * p[1] ** (1 - best))
    if np.ptp(overlaps) > 1e-6:
        assert pool("chernoff", p) == pytest.approx(oracle, abs=2e-2)


def test_median_ignores_one_liar_of_three():
    honest, liar = [0.8, 0.1, 0.1], [0.0, 0.0, 1.0]
    assert pool("median", [honest, honest, liar]) == pytest.approx(pool("median", [honest] * 3))


def test_one_liar_cannot_move_the_log_odds_beyond_the_bound():
    m = 4
    bound = np.log((1 - ROBUSTNESS + ROBUSTNESS / m) / (ROBUSTNESS / m))
    # The others know nothing, so that what comes out is the liar's doing alone.
    lied = pool("robust_product", [uniform(m), uniform(m), uniform(m), [0, 0, 0, 1.0]])
    assert np.log(lied[3] / lied[0]) == pytest.approx(bound)
