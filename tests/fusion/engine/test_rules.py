"""Each rule against a brute-force oracle, and the properties that its docstring claims; weights by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from common.probability import entropy_bits, normalise, uniform
from fusion.engine import rules
from fusion.engine.rules import RULES


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


@pytest.mark.parametrize("name", ["linear", "inverse_entropy", "min_entropy"])
@given(p=positive)
def test_linear_pools_stay_between_their_inputs(name, p):
    pooled = pool(name, p)
    assert (pooled >= p.min(0) - 1e-12).all() and (pooled <= p.max(0) + 1e-12).all()


@given(p=positive)
def test_product_is_bayes_rule_for_independent_observers(p):
    prior = rising(p.shape[1])
    oracle = np.array([prior[m] * np.prod([p[i, m] / prior[m] for i in range(len(p))]) for m in range(p.shape[1])])
    assert pool("product", p, prior) == pytest.approx(oracle / oracle.sum())


@pytest.mark.parametrize("name", ["product", "guarded_product"])
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


# Weights


PLAIN, LEAST = rules.inverse_entropy, rules.minimum_entropy


@pytest.mark.parametrize(
    ("weights_of", "bits", "weights"),
    [
        (PLAIN, [0.5, 1.0, 2.0], [4 / 7, 2 / 7, 1 / 7]),
        (PLAIN, [-0.0, 0.0], [0.5, 0.5]),
        (PLAIN, [0.0, 1.0], [1 / 1.01, 0.01 / 1.01]),  # a one-hot does not weigh infinitely
        (LEAST, [0.3, 0.3, 0.4], [0.5, 0.5, 0]),
        # Equal but for round-off
        (LEAST, [0.3, 0.3 + 1e-15, 0.4], [0.5, 0.5, 0]),
        (rules.equal_weights, [0.3, 4.0], [0.5, 0.5]),
    ],
)
def test_weights_by_hand(weights_of, bits, weights):
    assert weights_of(np.array(bits)) == pytest.approx(weights, abs=1e-4)


@pytest.mark.parametrize("weights_of", [PLAIN, LEAST])
@given(bits=arrays(np.float64, st.integers(1, 6), elements=st.floats(0, 5)))
def test_weights_sum_to_one_and_fall_with_entropy(weights_of, bits):
    weights = weights_of(bits)
    assert weights.sum() == pytest.approx(1) and (weights >= 0).all()
    assert (np.diff(weights[np.argsort(bits)]) <= 1e-12).all()
