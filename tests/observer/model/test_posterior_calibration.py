"""Posterior calibration: the formula by hand, its properties, and the fit of simulated results."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.probability import softmax
from observer.model.posterior_calibration import (
    CAUTIOUS,
    FEWEST_EXAMPLES,
    HeldOutResult,
    PosteriorCalibration,
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


@given(st.lists(st.floats(0, 1), min_size=2, max_size=12).filter(sum), st.floats(0, 1))
def test_rounding_over_the_facings_makes_no_probability_above_one_and_none_below_zero(shares, u):
    facing = np.array(shares) / sum(shares)
    # A sum that is above 1 by rounding, as of a model that is certain of something else.
    unlearned = np.nextafter(facing, 2) * (1.0 if u > 0.5 else u)
    joint = np.full((2, len(facing)), 0.5 / len(facing))
    watch = SimpleNamespace(joint=joint, unlearned=unlearned)
    p, something_else = calibrated_posterior(watch, PosteriorCalibration(1.5, 0.0))
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


def results(rng, overconfidence, count=1500, movements=6, errors=0.0):
    """Results of a model that reports the right posterior to a power; `errors`: share of random truths."""
    outcome = []
    for _ in range(count):
        right = rng.dirichlet(np.full(movements, 0.5))
        truth = int(rng.choice(movements, p=right))
        if rng.random() < errors:
            truth = int(rng.integers(movements))
        outcome.append(HeldOutResult(truth, softmax(overconfidence * np.log(np.maximum(right, 1e-300)))[None]))
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
    fitted = fit_calibration(results(np.random.default_rng(0), overconfidence, errors=errors))
    assert fitted.temperature == pytest.approx(overconfidence, rel=within)
    assert doubts[0] <= fitted.doubt <= doubts[1]


def test_the_fewer_the_examples_the_more_cautious_is_the_fit():
    enough = results(np.random.default_rng(0), 1.0, FEWEST_EXAMPLES)
    doubts = [fit_calibration(enough[:n]).doubt for n in (0, 15, FEWEST_EXAMPLES)]
    assert doubts == sorted(doubts, reverse=True) and len(set(doubts)) == len(doubts)
    assert fit_calibration([]) == CAUTIOUS


@pytest.mark.parametrize("count", [5, 10])
def test_a_fit_of_few_examples_is_the_geometric_mean_of_it_and_of_caution(count):
    """Examples that are recognised with .99: the fit alone has the lowest temperature."""
    fitted = fit_calibration([HeldOutResult(0, np.array([[0.99, 0.01]]))] * count)
    share = count / FEWEST_EXAMPLES
    assert fitted.temperature == pytest.approx(CAUTIOUS.temperature ** (1 - share) * 0.5**share)
    assert fitted.doubt == pytest.approx(CAUTIOUS.doubt)
