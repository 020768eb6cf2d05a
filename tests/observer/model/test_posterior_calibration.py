"""Posterior calibration: the formula by hand, its properties, and the fit of simulated results."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from common.probability import softmax
from observer.model.posterior_calibration import (
    CAUTIOUS,
    FEWEST_EXAMPLES,
    MAX_EVIDENCE,
    HeldOutResult,
    PosteriorCalibration,
    _logistic,
    _nearly_cautious,
    _weights,
    calibrated_posterior,
    fit_calibration,
)

SHAPES = st.sampled_from([(2,), (5,), (3, 4), (20, 12)])
TEMPERATURES = st.floats(0.5, 8.0)
DOUBTS = st.floats(0.0, 0.3)
some = settings(max_examples=30, deadline=None)


def random_posterior(shape, seed, sharpness=0.3):
    return np.random.default_rng(seed).dirichlet(np.full(int(np.prod(shape)), sharpness)).reshape(shape)


def test_by_hand():
    # The square roots of 0.64 and 0.04 are 0.8 and 0.2, and a tenth is spread evenly.
    assert PosteriorCalibration(2.0, 0.1).apply(np.array([16 / 17, 1 / 17])) == pytest.approx(
        [0.9 * 0.8 + 0.05, 0.9 * 0.2 + 0.05]
    )
    assert PosteriorCalibration(3.0, 0.2).apply(np.array([1.0, 0.0])) == pytest.approx([0.9, 0.1])


@given(st.lists(st.floats(0, 1), min_size=2, max_size=12).filter(sum), st.floats(0, 1), st.booleans())
def test_rounding_over_the_facings_makes_no_probability_above_one_and_none_below_zero(shares, u, learned_only):
    facing = np.array(shares) / sum(shares)
    # A sum that is above 1 by rounding, as of a model that is certain of something else.
    unlearned = np.nextafter(facing, 2) * (1.0 if u > 0.5 else u)
    joint = np.full((2, len(facing)), 0.5 / len(facing))
    watch = SimpleNamespace(joint=joint, unlearned=unlearned)
    calibration = PosteriorCalibration(1.5, 0.0, learned_only=learned_only)
    p, something_else = calibrated_posterior(watch, calibration)
    assert 0 <= something_else <= 1 and p.min() >= 0 and p.sum() == pytest.approx(1)


@some
@given(shape=SHAPES, seed=st.integers(0, 999))
def test_no_calibration_changes_nothing(shape, seed):
    posterior = random_posterior(shape, seed)
    np.testing.assert_array_equal(PosteriorCalibration().apply(posterior), posterior)


@some
@given(shape=SHAPES, seed=st.integers(0, 999), temperature=TEMPERATURES, doubt=DOUBTS)
def test_the_order_stays_and_the_sum_is_one(shape, seed, temperature, doubt):
    before = random_posterior(shape, seed)
    after = PosteriorCalibration(temperature, doubt).apply(before)
    assert after.shape == before.shape and after.sum() == pytest.approx(1)
    assert (after >= doubt / after.size - 1e-12).all()
    assert after.ravel()[before.argmax()] == after.max()


@some
@given(seed=st.integers(0, 999), temperature=TEMPERATURES, doubt=DOUBTS)
def test_one_facing_is_the_same_as_none(seed, temperature, doubt):
    p = random_posterior((6,), seed)
    calibration = PosteriorCalibration(temperature, doubt)
    assert calibration.apply(p[:, None])[:, 0] == pytest.approx(calibration.apply(p))


STATS = ((-1.0, 0.5), (-2.0, 1.0), (-1.5, 0.25))
KNOWING = PosteriorCalibration(likelihood_statistics=STATS, unlike=2.0, slope=1.5)
LEAST, MOST = (1 / (1 + 3 * np.exp(-hint)) for hint in (-MAX_EVIDENCE, MAX_EVIDENCE))


@pytest.mark.parametrize("m", range(3))
def test_with_even_odds_unlearned_has_its_prior(m):
    p, (mean, spread) = np.eye(3)[m], STATS[m]
    log_likelihood = np.full(3, 7.0)
    log_likelihood[m] = mean - 2.0 * spread
    assert KNOWING.unlearned(p, log_likelihood) == pytest.approx(1 / 4)


@some
@given(seed=st.integers(0, 999), worse=st.floats(0.01, 3.0))
def test_unlearned_grows_as_the_likelihood_falls(seed, worse):
    rng = np.random.default_rng(seed)
    p, log_likelihood = rng.dirichlet(np.ones(3)), rng.uniform(-3, 0, 3)
    before, after = KNOWING.unlearned(p, log_likelihood), KNOWING.unlearned(p, log_likelihood - worse)
    assert 0 < before <= after < 1
    assert before < after or before in (pytest.approx(LEAST), pytest.approx(MOST))


def test_the_evidence_for_unlearned_is_bounded():
    p = np.array([0.9, 0.05, 0.05])
    assert KNOWING.unlearned(p, np.full(3, 1e9)) == pytest.approx(LEAST)
    assert KNOWING.unlearned(p, np.full(3, -1e9)) == pytest.approx(MOST)


def test_without_statistics_unlearned_is_unknown():
    p = np.full(3, 1 / 3)
    assert KNOWING.unlearned(p, None) is None
    assert PosteriorCalibration(2.0, 0.1).unlearned(p, np.zeros(3)) is None


def results(rng, overconfidence, count=1500, movements=6, errors=0.0):
    """Results of a model that reports the right posterior to a power; `errors`: share of random truths."""
    outcome = []
    for _ in range(count):
        right = rng.dirichlet(np.full(movements, 0.5))
        truth = int(rng.choice(movements, p=right))
        if rng.random() < errors:
            truth = int(rng.integers(movements))
        outcome.append(HeldOutResult(truth, softmax(overconfidence * np.log(np.maximum(right, 1e-300)))[None], None))
    return outcome


@pytest.mark.parametrize(
    ("overconfidence", "errors", "within", "doubts"),
    [
        (1.0, 0.0, 0.12, (0, 0.01)),
        (2.0, 0.0, 0.12, (0, 0.01)),
        (4.0, 0.0, 0.12, (0, 0.01)),
        (1.0, 0.1, 0.2, (0.05, 0.2)),
    ],
)
def test_the_fit_finds_temperature_and_doubt(overconfidence, errors, within, doubts):
    fitted = fit_calibration(results(np.random.default_rng(0), overconfidence, errors=errors), 6)
    assert fitted.temperature == pytest.approx(overconfidence, rel=within) and fitted.likelihood_statistics == ()
    assert doubts[0] <= fitted.doubt <= doubts[1]


def test_the_fewer_the_examples_the_more_cautious_is_the_fit():
    enough = results(np.random.default_rng(0), 1.0, FEWEST_EXAMPLES)
    doubts = [fit_calibration(enough[:n], 6).doubt for n in (0, 15, FEWEST_EXAMPLES)]
    assert doubts == sorted(doubts, reverse=True) and len(set(doubts)) == len(doubts)
    assert fit_calibration([], 6) == CAUTIOUS


def test_a_fit_of_few_examples_is_the_geometric_mean_of_it_and_of_caution():
    assert _nearly_cautious(1.0, 0.01, 1.0) == PosteriorCalibration(1.0, 0.01)
    assert _nearly_cautious(1.0, 0.01, 0.0) == CAUTIOUS
    half = _nearly_cautious(1.0, 0.01, 0.5)
    assert half.temperature == pytest.approx(np.sqrt(CAUTIOUS.temperature))
    assert half.doubt == pytest.approx(np.sqrt(CAUTIOUS.doubt * 0.01))


def test_all_examples_of_something_else_weigh_as_much_as_those_of_one_movement():
    """However many there are: the same ones ten times give the same calibration."""
    rng = np.random.default_rng(1)
    own, other = results(rng, 2.0, 300, movements=3), results(rng, 0.5, 300, movements=3)
    shown = [t for t in own if t.truth < 2]
    background = [HeldOutResult(2, t.posteriors, None) for t in other]
    truth = np.repeat([0, 1, 2], [20, 40, 7])
    assert _weights(truth, 2)[truth == 2].sum() == pytest.approx(60 / 2)
    assert (_weights(truth, 2)[truth < 2] == 1).all()
    once, often = (fit_calibration([*shown, *background * times], 2) for times in (1, 10))
    assert once == often != fit_calibration(shown, 2)


@pytest.mark.parametrize("apart", [1.0, 30.0])
def test_the_odds_of_something_else_are_those_of_a_general_minimiser(apart):
    """Logistic regression with the ridge .05 |w|^2, on values cut off at 10 spreads: also of separable ones."""
    rng = np.random.default_rng(0)
    own, other = rng.normal(0, 1, 40), rng.normal(apart, 1, 40)
    x, y = np.clip(np.concatenate([own, other]), -10, 10), np.repeat([0.0, 1.0], 40)

    def loss(w):
        return np.logaddexp(0, np.where(y > 0, -1, 1) * (w[0] * x + w[1])).sum() + 0.05 * (w**2).sum()

    slope, offset = minimize(loss, np.zeros(2), tol=1e-12).x
    assert _logistic(own, other) == pytest.approx((slope, -offset / slope), rel=1e-3)


def results_with_likelihoods(rng, spreads_apart, count=200):
    """Results with mean -1 and -2 and spread 0.3; the other movement lies `spreads_apart` spreads lower."""
    outcome = []
    for n in range(count):
        truth, means = n % 2, np.array([-1.0, -2.0])
        log_likelihood = rng.normal(means, 0.3)
        log_likelihood[1 - truth] -= spreads_apart * 0.3
        outcome.append(HeldOutResult(truth, np.array([[0.9, 0.1], [0.1, 0.9]])[[truth]], log_likelihood))
    return outcome


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 20))
def test_the_fit_learns_statistics_and_odds_of_unlearned(seed):
    fitted = fit_calibration(results_with_likelihoods(np.random.default_rng(seed), spreads_apart=6.0), 2)
    assert np.array(fitted.likelihood_statistics) == pytest.approx(np.array([(-1.0, 0.3), (-2.0, 0.3)]), abs=0.08)
    assert 1.5 < fitted.unlike < 4.5 and fitted.slope > 0
    for m, mean in enumerate((-1.0, -2.0)):
        like, unlike = (fitted.unlearned(np.eye(2)[m], np.full(2, mean - below)) for below in (0.0, 1.8))
        assert like < 1 / 3 < unlike


def test_a_movement_with_one_example_gets_the_statistics_of_the_others():
    examples = results_with_likelihoods(np.random.default_rng(0), 6.0, count=30)
    alone = HeldOutResult(2, np.full((1, 3), 1 / 3), np.array([-3.0, -3.0, -1.2]))
    widened = [
        HeldOutResult(t.truth, np.append(t.posteriors, [[0.0]], axis=1), np.append(t.log_likelihood, -9.0))
        for t in examples
    ]
    own = [t.log_likelihood[t.truth] for t in widened] + [-1.2]
    mean, spread = fit_calibration([*widened, alone], 3).likelihood_statistics[2]
    assert mean == pytest.approx(np.mean(own)) and spread > np.std(own)
