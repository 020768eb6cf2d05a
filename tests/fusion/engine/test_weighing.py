"""What trust and learned correlations do to the weights of the default rule."""

import numpy as np
import pytest
from engine_stage import posteriors
from hypothesis import given
from hypothesis import strategies as st

from common.probability import uniform
from fusion.engine.guarded_product import guarded_weights
from fusion.engine.weighing import ObserverTrust


def weighed(p, trust=None):
    """The weights, and the exponents while nobody is held to be wrong, with a uniform prior."""
    weights = guarded_weights(p, uniform(p.shape[1]), trust or ObserverTrust.unknown(len(p)))
    return weights, weights.exponents[0]


def test_less_trust_is_a_smaller_share():
    p = np.array([[0.1, 0.8, 0.1], [0.6, 0.2, 0.2], [0.3, 0.4, 0.3]])
    trusts = [ObserverTrust(np.array([t, 1.0, 1.0]), np.zeros((3, 3))) for t in (1.0, 0.5, 0.1)]
    shares = [weighed(p, trust)[0].shares[0] for trust in trusts]
    assert shares[0] > shares[1] > shares[2] > 0


def test_observers_that_were_learned_to_be_correlated_share_one_weight():
    p = np.array([[0.8, 0.1, 0.05, 0.05], [0.6, 0.25, 0.1, 0.05], [0.5, 0.1, 0.3, 0.1]])
    correlations = np.zeros((3, 3))
    correlations[0, 1] = correlations[1, 0] = 1.0
    (alone, alone_exponents), (known, exponents) = weighed(p), weighed(p, ObserverTrust(np.ones(3), correlations))
    assert exponents[:2].sum() < 0.8 * alone_exponents[:2].sum()
    assert known.shares[:2].sum() < alone.shares[:2].sum()


@given(posteriors(4), st.lists(st.floats(0.1, 1), min_size=4, max_size=4), st.floats(0, 1))
def test_with_any_trust_all_is_in_range(p, trust, rho):
    weights, _ = weighed(p, ObserverTrust(np.array(trust), np.full((4, 4), rho) * (1 - np.eye(4))))
    assert np.isfinite(weights.exponents).all() and weights.shares.sum() == pytest.approx(1)
    assert (weights.exponents >= 0).all() and (weights.exponents <= 1 + 1e-9).all()
    assert ((weights.epsilon > 0) & (weights.epsilon < 1)).all()
