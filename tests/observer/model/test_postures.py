"""Distances to many postures against plain sums, and bounds on their evidence."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.features import groups_of
from observer.model.chain_filter import FLOOR, PostureEvidence, Postures, RestPostures

PARTS, PHASES, CHAINS = 3, 4, 5
GROUPS = groups_of(PARTS)
SIZE = len(GROUPS)
CELL_OF = np.array([0, 1, 2, 3, 3])
"""Two movements at two facings."""
SEEDS = st.integers(0, 10_000)
some = settings(max_examples=25, deadline=None)
MISSING = st.sets(st.integers(0, int(GROUPS.max())))


def drawn(seed, phases=PHASES):
    return np.random.default_rng(seed).normal(0, 1.5, (phases, SIZE, CHAINS)).astype(np.float32)


def features_of(seed, missing):
    features = np.random.default_rng([seed, 1]).normal(0, 1.5, SIZE)
    features[np.isin(GROUPS, list(missing))] = np.nan
    return features


@some
@given(seed=SEEDS, missing=MISSING, phases=st.integers(1, PHASES))
def test_squared_distances_of_the_known_features(seed, missing, phases):
    postures, features = drawn(seed), features_of(seed, missing)
    distances = Postures(postures).squared_distances(features, phases)
    plain = np.nansum((postures.astype(np.float64) - features[:, None]) ** 2, axis=1)[:phases]
    assert distances.dtype == np.float32 and (distances >= 0).all()
    np.testing.assert_allclose(distances, plain, atol=1e-4)


@some
@given(seed=SEEDS, missing=MISSING, live=st.sets(st.integers(0, CHAINS - 1), min_size=1))
def test_distances_of_selected_chains(seed, missing, live):
    whole, features, some = Postures(drawn(seed)), features_of(seed, missing), np.array(sorted(live))
    distances = whole.select(some).squared_distances(features, PHASES)
    np.testing.assert_allclose(distances, whole.squared_distances(features, PHASES)[:, some], atol=1e-4)


def evidence(features, postures, outlier=5.0, sharpness=1.0):
    at_rest = RestPostures(drawn(11, 1)[0].T, drawn(12, 1)[0].T, CELL_OF, (2, 2))
    return PostureEvidence(Postures(postures), at_rest, sharpness, outlier).see(features)


@some
@given(seed=SEEDS, missing=MISSING, outlier=st.floats(1.0, 20.0), sharpness=st.floats(0.1, 2.0))
def test_likelihoods_are_gaussian_with_a_floor(seed, missing, outlier, sharpness):
    postures, features = drawn(seed), features_of(seed, missing)
    likelihood, log_scale = evidence(features, postures, outlier, sharpness).chains(None, PHASES)
    plain = -sharpness * np.nansum((postures.astype(np.float64) - features[:, None]) ** 2, axis=1)
    assert log_scale == pytest.approx(plain.max(), abs=1e-3)
    np.testing.assert_allclose(likelihood, np.exp(plain - plain.max()) + np.exp(-outlier), rtol=1e-3)


@some
@given(seed=SEEDS, missing=MISSING)
def test_the_likelihoods_of_rest_and_of_rest_after_each_movement(seed, missing):
    # Near enough that the floor plays no part.
    features = features_of(seed, missing) / 3
    frame = evidence(features, drawn(seed), sharpness=0.3)
    first, last = (np.exp(-0.3 * np.nansum((drawn(n, 1)[0] - features[:, None]) ** 2, axis=0)) for n in (11, 12))
    rest = np.array([np.mean([first[k == CELL_OF % 2], last[k == CELL_OF % 2]]) for k in range(2)])
    own = np.array([[last[2 * m + k == CELL_OF].mean() for k in range(2)] for m in range(2)])
    assert frame.rest == pytest.approx(np.log(rest.max()), abs=1e-3)
    np.testing.assert_allclose(frame.after, np.log(np.maximum(own, rest)), atol=1e-3)


def test_rest_is_never_impossible():
    features = np.full(SIZE, 1e3)
    frame = evidence(features, drawn(0))
    assert frame.rest == pytest.approx(FLOOR, abs=1e-3) and np.allclose(frame.after, FLOOR, atol=1e-3)
