"""The pool of members' posteriors: exponents learned from held-out examples."""

import numpy as np
import pytest

from observer.model.log_linear_pool import learn_exponents, pooled

DEFAULTS = (0.6, 1.0)
MOVEMENTS = 6


def members_of(count, informed, seed=0):
    """(N, 1, 2, M): members that see the truth through noise, sharp as calibrated ones; informed: of each, 0 or 1."""
    rng = np.random.default_rng(seed)
    truth = np.arange(count) % MOVEMENTS
    members = []
    for knows in informed:
        scores = rng.normal(0, 1, (count, MOVEMENTS))
        if knows:
            # With noise of variance 1 and this difference of means, scores times it are calibrated logarithms.
            scores[np.arange(count), truth] += 2.0
        members.append(np.exp(2.0 * scores))
    p = np.stack(members, axis=1)[:, None]
    return p / p.sum(axis=-1, keepdims=True), truth


def test_a_pool_of_one_member_is_that_member():
    p, _ = members_of(5, (1, 1))
    np.testing.assert_allclose(pooled(p, (1.0, 0.0)), np.maximum(p[:, :, 0], 1e-4), atol=1e-3)


def test_a_member_that_knows_nothing_is_not_relied_on():
    generative, discriminative = learn_exponents(*members_of(600, (0, 1)), DEFAULTS, (False, False))
    assert generative <= 0.1 and 0.8 <= discriminative <= 1.2


def test_independent_calibrated_members_are_multiplied():
    assert np.allclose(learn_exponents(*members_of(900, (1, 1)), DEFAULTS, (False, False)), 1.0, atol=0.25)


def test_the_same_member_twice_counts_once():
    p, truth = members_of(900, (1, 1))
    p[:, :, 1] = p[:, :, 0]
    assert sum(learn_exponents(p, truth, DEFAULTS, (False, False))) == pytest.approx(1.0, abs=0.25)


def test_with_few_examples_exponents_stay_near_their_defaults():
    few = learn_exponents(*members_of(3, (0, 1)), DEFAULTS, (False, False))
    assert np.abs(np.subtract(few, DEFAULTS)).max() <= 0.35
    assert learn_exponents(np.zeros((0, 1, 2, MOVEMENTS)), np.zeros(0, int), DEFAULTS, (False, False)) == DEFAULTS


def test_an_explicit_exponent_stays():
    generative, _ = learn_exponents(*members_of(600, (0, 1)), DEFAULTS, (True, False))
    assert generative == DEFAULTS[0]
