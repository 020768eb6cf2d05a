"""Each rule against a brute-force oracle, and the properties that its docstring claims; weights by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from common.errors import BadInput
from common.probability import entropy_bits, normalise, uniform
from fusion.engine import rules
from fusion.engine.rules import ROBUSTNESS, RULES


def pool(name, p, prior=None):
    p = np.asarray(p, dtype=float)
    return RULES[name].pool(p, uniform(p.shape[1]) if prior is None else np.asarray(prior, dtype=float)).p


def rising(size):
    return normalise(np.arange(1.0, size + 1))


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
    """A higher probability from one observer can lower the pooled one: a known price of the rule."""
    other = [0.9, 0.1, 0.0]
    assert pool("inverse_entropy", [[0.2, 0.1, 0.7], other])[0] == pytest.approx(0.698, abs=5e-4)
    assert pool("inverse_entropy", [[0.3, 0.0, 0.7], other])[0] == pytest.approx(0.692, abs=5e-4)


@pytest.mark.parametrize("name", ["linear", "inverse_entropy", "iest", "ieat", "min_entropy"])
@given(p=positive)
def test_linear_pools_stay_between_their_inputs(name, p):
    pooled = pool(name, p)
    assert (pooled >= p.min(0) - 1e-12).all() and (pooled <= p.max(0) + 1e-12).all()


@given(p=positive)
def test_product_is_bayes_rule_for_independent_observers(p):
    prior = rising(p.shape[1])
    oracle = np.array([prior[m] * np.prod([p[i, m] / prior[m] for i in range(len(p))]) for m in range(p.shape[1])])
    assert pool("product", p, prior) == pytest.approx(oracle / oracle.sum())


@pytest.mark.parametrize("name", ["product", "robust_product"])
@given(p=positive)
def test_an_observer_at_the_prior_is_neutral(name, p):
    prior = rising(p.shape[1])
    assert pool(name, np.vstack([p, prior]), prior) == pytest.approx(pool(name, p, prior))


@given(p=positive, seed=st.integers(0, 99))
def test_the_log_pool_is_idempotent_and_externally_bayesian(p, seed):
    assert pool("log", np.repeat(p[:1], 3, axis=0)) == pytest.approx(p[0])
    # Updating every observer by a shared likelihood, or the pooled posterior alone, gives the same.
    likelihood = np.random.default_rng(seed).uniform(0.1, 1, p.shape[1])
    assert pool("log", normalise(p * likelihood)) == pytest.approx(normalise(pool("log", p) * likelihood))


@given(p=arrays(np.float64, (2, 3), elements=st.floats(0.01, 1)).map(normalise))
def test_chernoff_minimises_the_overlap(p):
    a = np.linspace(0, 1, 2001)[:, None]
    overlaps = (p[0] ** a * p[1] ** (1 - a)).sum(1)
    best = a[overlaps.argmin(), 0]
    if np.ptp(overlaps) > 1e-6:
        assert pool("chernoff", p) == pytest.approx(normalise(p[0] ** best * p[1] ** (1 - best)), abs=2e-2)


def test_median_ignores_one_outlier_of_three():
    p = [0.8, 0.1, 0.1]
    assert pool("median", [p, p, [0.0, 0.0, 1.0]]) == pytest.approx(pool("median", [p] * 3))


def test_the_median_of_one_is_its_own_robust_posterior():
    p = np.array([0.8, 0.15, 0.05])
    assert pool("median", [p]) == pytest.approx((1 - ROBUSTNESS) * p + ROBUSTNESS / 3)


def test_chernoff_takes_two_observers_and_no_more():
    assert rules.get_rule("chernoff", 2).most_observers == 2
    with pytest.raises(BadInput, match="takes at most 2 observers, here are 3"):
        rules.get_rule("chernoff", 3)


def test_one_outlier_cannot_move_the_log_odds_beyond_the_bound():
    m = 4
    bound = np.log((1 - ROBUSTNESS + ROBUSTNESS / m) / (ROBUSTNESS / m))
    # The others know nothing, so that the result is the outlier's doing alone.
    pooled = pool("robust_product", [uniform(m), uniform(m), uniform(m), [0, 0, 0, 1.0]])
    assert np.log(pooled[3] / pooled[0]) == pytest.approx(bound)


# Weights


PLAIN, STATIC, AVERAGE, LEAST = (
    rules.inverse_entropy,
    rules.inverse_entropy_static_threshold,
    rules.inverse_entropy_average_threshold,
    rules.minimum_entropy,
)


@pytest.mark.parametrize(
    ("weights_of", "bits", "weights"),
    [
        (PLAIN, [0.5, 1.0, 2.0], [4 / 7, 2 / 7, 1 / 7]),
        (PLAIN, [-0.0, 0.0], [0.5, 0.5]),
        (PLAIN, [0.0, 1.0], [1 / 1.01, 0.01 / 1.01]),  # a one-hot does not weigh infinitely
        (STATIC, [0.5, 1.0, 2.0], [2 / 3, 1 / 3, 0]),
        (AVERAGE, [1.0, 2.0, 3.3], [2 / 3, 1 / 3, 0]),
        (LEAST, [0.3, 0.3, 0.4], [0.5, 0.5, 0]),
        # Equal but for round-off
        (LEAST, [0.3, 0.3 + 1e-15, 0.4], [0.5, 0.5, 0]),
        (AVERAGE, [1.0, 1.0 + 1e-13], [0.5, 0.5]),
        (rules.equal_weights, [0.3, 4.0], [0.5, 0.5]),
    ],
)
def test_weights_by_hand(weights_of, bits, weights):
    assert weights_of(np.array(bits)) == pytest.approx(weights, abs=1e-4)


@pytest.mark.parametrize("weights_of", [PLAIN, STATIC, AVERAGE, LEAST])
@given(bits=arrays(np.float64, st.integers(1, 6), elements=st.floats(0, 5)))
def test_weights_sum_to_one_and_fall_with_entropy(weights_of, bits):
    weights = weights_of(bits)
    assert weights.sum() == pytest.approx(1) and (weights >= 0).all()
    assert (np.diff(weights[np.argsort(bits)]) <= 1e-12).all()
