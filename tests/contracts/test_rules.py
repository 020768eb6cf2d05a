"""What every fusion rule must keep: any rule put into the registry is held to this."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from common.errors import BadInput
from common.probability import uniform
from fusion.engine.pooling import pool_joint
from fusion.engine.rules import DEFAULT_RULE, RULES, get_rule

ALL = list(RULES.values())
ids = [rule.name for rule in ALL]


def posteriors():
    """Distributions, exact zeros and one-hots among them."""

    def of(shape):
        return arrays(np.float64, shape, elements=st.sampled_from([0.0, 1e-12, 0.01, 0.2, 0.5, 1.0])).map(
            lambda a: (a + (a.sum(1, keepdims=True) == 0)) / (a + (a.sum(1, keepdims=True) == 0)).sum(1, keepdims=True)
        )

    return st.tuples(st.integers(1, 5), st.integers(2, 5)).flatmap(of)


def heard(rule, p):
    return p[: rule.most_observers]


@pytest.mark.parametrize("rule", ALL, ids=ids)
@given(p=posteriors())
def test_gives_a_distribution_whatever_it_hears(rule, p):
    p = heard(rule, p)
    pooled = rule.pool(p, uniform(p.shape[1]))
    assert pooled.p.shape == (p.shape[1],)
    assert np.isfinite(pooled.p).all() and (pooled.p >= 0).all() and pooled.p.sum() == pytest.approx(1)
    assert pooled.weights.shape == (len(p),) and pooled.weights.sum() == pytest.approx(1)


@pytest.mark.parametrize("rule", ALL, ids=ids)
@given(p=posteriors(), seed=st.integers(0, 99))
def test_the_order_of_observers_does_not_matter_and_labels_may_be_reordered(rule, p, seed):
    p = heard(rule, p)
    rng = np.random.default_rng(seed)
    rows, columns = rng.permutation(p.shape[0]), rng.permutation(p.shape[1])
    prior = uniform(p.shape[1])
    plain = rule.pool(p, prior)
    assert rule.pool(p[rows], prior).p == pytest.approx(plain.p, abs=1e-6)
    assert rule.pool(p[:, columns], prior).p == pytest.approx(plain.p[columns], abs=1e-6)


@pytest.mark.parametrize("rule", ALL, ids=ids)
def test_disjoint_certainties_and_one_hots_give_no_nan(rule):
    p = np.array([[1.0, 0, 0], [0, 1.0, 0]])
    assert np.isfinite(rule.pool(p, uniform(3)).p).all()


@pytest.mark.parametrize("rule", ALL, ids=ids)
def test_does_not_change_what_it_hears(rule):
    p = np.array([[0.7, 0.2, 0.1], [0.1, 0.6, 0.3]])
    before = p.copy()
    rule.pool(p, uniform(3))
    assert (p == before).all()


# The others have thresholds, or search for a minimum: there the last digit of a sum over facings may choose.
STEADY = [rule for rule in ALL if rule.name not in ("chernoff", "iest", "ieat", "min_entropy")]


@pytest.mark.parametrize("rule", STEADY, ids=lambda rule: rule.name)
@given(p=posteriors(), size=st.integers(1, 4), seed=st.integers(0, 99))
def test_movement_and_facing_together_keep_the_same(rule, p, size, seed):
    p = heard(rule, p)
    rng = np.random.default_rng(seed)
    cells = p[:, :, None] * rng.dirichlet(np.full(size, 0.5), p.shape)
    rows, columns, turned = (rng.permutation(n) for n in cells.shape)
    prior = uniform(p.shape[1])
    plain = pool_joint(rule, cells, prior).cells
    assert plain.shape == cells.shape[1:] and np.isfinite(plain).all() and (plain >= 0).all()
    assert plain.sum() == pytest.approx(1)
    assert pool_joint(rule, cells[rows], prior).cells == pytest.approx(plain, abs=1e-6)
    assert pool_joint(rule, cells[:, columns], prior).cells == pytest.approx(plain[columns], abs=1e-6)
    assert pool_joint(rule, cells[:, :, turned], prior).cells == pytest.approx(plain[:, turned], abs=1e-6)


@pytest.mark.parametrize("rule", STEADY, ids=lambda rule: rule.name)
@given(p=posteriors(), size=st.integers(1, 4))
def test_facing_that_says_nothing_is_as_if_it_were_not(rule, p, size):
    p = heard(rule, p)
    cells = np.repeat(p[:, :, None] / size, size, axis=2)
    prior = uniform(p.shape[1])
    found = pool_joint(rule, cells, prior)
    if rule.name != "median":  # of log odds, which a finer table changes
        assert found.cells.sum(axis=1) == pytest.approx(rule.pool(p, prior).p, abs=1e-6)
    assert found.weights == pytest.approx(rule.pool(p, prior).weights)


@pytest.mark.parametrize("rule", ALL, ids=ids)
def test_agreeing_observers_are_agreed_with(rule):
    p = np.array([[0.7, 0.2, 0.1], [0.6, 0.3, 0.1]])
    assert rule.pool(p, uniform(3)).p.argmax() == 0


def test_the_default_is_known():
    assert get_rule(DEFAULT_RULE).name == DEFAULT_RULE


def test_an_unknown_rule_is_named_with_its_nearest():
    with pytest.raises(BadInput, match=r"fusion.rule = 'logpol'.*known: .*inverse_entropy.*log"):
        get_rule("logpol")


def test_a_rule_that_cannot_hear_so_many_says_so():
    with pytest.raises(BadInput, match="at most 2 observers, here are 4"):
        get_rule("chernoff", 4)
