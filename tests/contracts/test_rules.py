"""Properties of every registered fusion rule."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from common.errors import BadInput
from common.fusion_rules import RETIRED_RULES
from common.probability import normalise, uniform
from fusion.engine.pooling import pool_joint
from fusion.engine.rules import DEFAULT_RULE, RULES, get_rule

ALL = list(RULES.values())
# The other has a threshold: there the last digit of a sum over facings may decide.
STEADY = [rule for rule in ALL if rule.name not in ("min_entropy",)]
each_rule = pytest.mark.parametrize("rule", ALL, ids=lambda rule: rule.name)

MASSES = st.sampled_from([0.0, 1e-12, 0.01, 0.2, 0.5, 1.0])
POSTERIORS = st.tuples(st.integers(1, 5), st.integers(2, 5)).flatmap(lambda s: arrays(np.float64, s, elements=MASSES))
POSTERIORS = POSTERIORS.map(normalise)
"""(N, M) distributions, among them exact zeros and one-hots."""


# Every rule pools the same drawn posteriors: to draw them takes longer than to pool them.
@given(p=POSTERIORS)
def test_any_posteriors_give_a_distribution_and_stay_unchanged(p):
    for rule in ALL:
        before = p.copy()
        pooled = rule.pool(p, uniform(p.shape[1]))
        assert pooled.p.shape == (p.shape[1],), rule.name
        assert np.isfinite(pooled.p).all() and (pooled.p >= 0).all() and pooled.p.sum() == pytest.approx(1), rule.name
        assert pooled.weights.shape == (len(p),) and pooled.weights.sum() == pytest.approx(1), rule.name
        assert (p == before).all(), rule.name


@given(p=POSTERIORS, seed=st.integers(0, 99))
def test_observers_and_labels_may_be_reordered(p, seed):
    for rule in ALL:
        rng = np.random.default_rng(seed)
        rows, columns = rng.permutation(p.shape[0]), rng.permutation(p.shape[1])
        prior = uniform(p.shape[1])
        plain = rule.pool(p, prior)
        assert rule.pool(p[rows], prior).p == pytest.approx(plain.p, abs=1e-6), rule.name
        assert rule.pool(p[:, columns], prior).p == pytest.approx(plain.p[columns], abs=1e-6), rule.name


@each_rule
def test_disjoint_certainties_give_no_nan_and_agreement_is_followed(rule):
    assert np.isfinite(rule.pool(np.array([[1.0, 0, 0], [0, 1.0, 0]]), uniform(3)).p).all()
    assert rule.pool(np.array([[0.7, 0.2, 0.1], [0.6, 0.3, 0.1]]), uniform(3)).p.argmax() == 0


@given(p=POSTERIORS, size=st.integers(1, 4), seed=st.integers(0, 99))
def test_the_same_holds_for_movement_and_facing_together(p, size, seed):
    for rule in STEADY:
        rng = np.random.default_rng(seed)
        cells = p[:, :, None] * rng.dirichlet(np.full(size, 0.5), p.shape)
        rows, columns, turned = (rng.permutation(n) for n in cells.shape)
        prior = uniform(p.shape[1])
        plain = pool_joint(rule, cells, prior).p
        assert plain.shape == cells.shape[1:] and np.isfinite(plain).all() and (plain >= 0).all(), rule.name
        assert plain.sum() == pytest.approx(1), rule.name
        assert pool_joint(rule, cells[rows], prior).p == pytest.approx(plain, abs=1e-6), rule.name
        assert pool_joint(rule, cells[:, columns], prior).p == pytest.approx(plain[columns], abs=1e-6), rule.name
        assert pool_joint(rule, cells[:, :, turned], prior).p == pytest.approx(plain[:, turned], abs=1e-6), rule.name


@given(p=POSTERIORS, size=st.integers(1, 4))
def test_a_uniform_facing_changes_nothing(p, size):
    for rule in STEADY:
        cells, prior = np.repeat(p[:, :, None] / size, size, axis=2), uniform(p.shape[1])
        joint, plain = pool_joint(rule, cells, prior), rule.pool(p, prior)
        assert joint.p.sum(axis=1) == pytest.approx(plain.p, abs=1e-6), rule.name
        assert joint.weights == pytest.approx(plain.weights), rule.name


def test_rules_are_found_by_name():
    assert get_rule(DEFAULT_RULE).name == DEFAULT_RULE
    with pytest.raises(BadInput, match=r"fusion\.rule = 'logpol': unknown rule; did you mean log\?"):
        get_rule("logpol")
    with pytest.raises(BadInput, match=r"unknown rule; known: .*inverse_entropy.*log"):
        get_rule("xyz")
    assert set(RETIRED_RULES.values()) <= set(RULES)


def test_of_a_rule_that_is_gone_the_error_names_another_and_the_earlier_default_stands_for_the_default():
    assert get_rule("robust_inverse_entropy").name == DEFAULT_RULE
    with pytest.raises(BadInput, match=r"fusion\.rule = 'median': this rule is gone; use 'log'"):
        get_rule("median")
    with pytest.raises(BadInput, match=r"--rule 'iest': this rule is gone; use 'inverse_entropy'"):
        get_rule("iest", "--rule")
