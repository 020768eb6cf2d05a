"""What trust and learned correlations do to the weights, the same in both rules that know them."""

import numpy as np
import pytest
from engine_stage import posteriors
from hypothesis import given
from hypothesis import strategies as st

from common.probability import uniform
from fusion.engine.guarded_product import guarded_weights
from fusion.engine.robust_inverse_entropy import CAP, robust_weights
from fusion.engine.weighing import ObserverTrust

MOST = {guarded_weights: 1.0, robust_weights: CAP}
"""The largest exponent that each rule gives."""


@pytest.fixture(params=MOST, ids=["guarded_product", "robust_inverse_entropy"], scope="module")
def rule(request):
    return request.param


@pytest.fixture(scope="module")
def weighed(rule):
    """Weighs posteriors with a uniform prior; the exponents are those while nobody is held to be wrong."""

    def weigh(p, trust=None):
        weights = rule(p, uniform(p.shape[1]), trust or ObserverTrust.unknown(len(p)))
        return weights, np.atleast_2d(weights.exponents)[0]

    return weigh


def test_less_trust_is_a_smaller_share(weighed):
    p = np.array([[0.1, 0.8, 0.1], [0.6, 0.2, 0.2], [0.3, 0.4, 0.3]])
    trusts = [ObserverTrust(np.array([t, 1.0, 1.0]), np.zeros((3, 3))) for t in (1.0, 0.5, 0.1)]
    shares = [weighed(p, trust)[0].shares[0] for trust in trusts]
    assert shares[0] > shares[1] > shares[2] > 0


def test_observers_that_were_learned_to_be_correlated_share_one_weight(weighed):
    p = np.array([[0.8, 0.1, 0.05, 0.05], [0.6, 0.25, 0.1, 0.05], [0.5, 0.1, 0.3, 0.1]])
    correlations = np.zeros((3, 3))
    correlations[0, 1] = correlations[1, 0] = 1.0
    (alone, alone_exponents), (known, exponents) = weighed(p), weighed(p, ObserverTrust(np.ones(3), correlations))
    assert exponents[:2].sum() < 0.8 * alone_exponents[:2].sum()
    assert known.shares[:2].sum() < alone.shares[:2].sum()


@given(posteriors(4), st.lists(st.floats(0.1, 1), min_size=4, max_size=4), st.floats(0, 1))
def test_with_any_trust_all_is_in_range(rule, weighed, p, trust, rho):
    weights, _ = weighed(p, ObserverTrust(np.array(trust), np.full((4, 4), rho) * (1 - np.eye(4))))
    assert np.isfinite(weights.exponents).all() and weights.shares.sum() == pytest.approx(1)
    assert (weights.exponents >= 0).all() and (weights.exponents <= MOST[rule] + 1e-9).all()
    assert ((weights.epsilon > 0) & (weights.epsilon < 1)).all()
