"""Logistic regression: its gradient, its optimum against a general minimiser, and what must not matter."""

import numpy as np
import pytest
from scipy.optimize import minimize

from observer.model.logistic import LogisticRegression, _Loss

ROWS, COLUMNS, CLASSES = 40, 5, 3


@pytest.fixture
def problem():
    rng = np.random.default_rng(1)
    features = rng.normal(size=(ROWS, COLUMNS)).astype(np.float32)
    truth = (features[:, 0] > 0.4).astype(int) + (features[:, 1] > 0)
    targets = (0.8 * np.eye(CLASSES)[truth] + 0.2 / CLASSES).astype(np.float32)
    return features, targets


def probabilities(features, targets, at=None, iterations=400, kinds=()):
    learned = LogisticRegression.learn(features, targets, 0.3, iterations, kinds)
    return np.exp(learned.log_probabilities(features if at is None else at))


@pytest.mark.parametrize("kinds", [(), (2,), (1, 3)])
def test_the_gradient_is_that_of_finite_differences(problem, kinds):
    features, targets = problem
    loss = _Loss(features.astype(np.float64), targets.astype(np.float64), 0.3, kinds)
    w = np.random.default_rng(2).normal(size=(COLUMNS + 1, CLASSES))
    _, gradient = loss(w)
    for place in np.ndindex(*w.shape):
        step = np.zeros_like(w)
        step[place] = 1e-5
        numeric = (loss(w + step)[0] - loss(w - step)[0]) / 2e-5
        assert gradient[place] == pytest.approx(numeric, abs=1e-4)


@pytest.mark.parametrize("kinds", [(), (2,)])
def test_the_optimum_is_that_of_a_general_minimiser(problem, kinds):
    """With several kinds the loss is the mean of those of all features and of each kind where the others are 0."""
    features, targets = problem
    spread = features.std(axis=0) + 0.05
    x = (features - features.mean(axis=0)) / spread
    shown = [x, np.hstack([x[:, :2], 0 * x[:, 2:]]), np.hstack([0 * x[:, :2], x[:, 2:]])] if kinds else [x]

    def loss(flat):
        w = flat.reshape(COLUMNS + 1, CLASSES)
        scores = np.array([one @ w[:-1] + w[-1] for one in shown])
        cross_entropy = np.log(np.exp(scores).sum(axis=2)) - (scores * targets).sum(axis=2)
        return 0.3 * cross_entropy.mean(axis=0).sum() + 0.5 * (w[:-1] ** 2).sum()

    w = minimize(loss, np.zeros((COLUMNS + 1) * CLASSES), tol=1e-12).x.reshape(COLUMNS + 1, CLASSES)
    expected = np.exp(x @ w[:-1] + w[-1])
    expected /= expected.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(probabilities(*problem, kinds=kinds), expected, atol=0.01)


def test_a_feature_that_never_varies_in_training_hardly_decides(problem):
    features, targets = problem
    constant = np.hstack([features, np.full((ROWS, 1), 2.0, np.float32)])
    other = constant.copy()
    other[:, -1] = 3.0
    np.testing.assert_allclose(probabilities(constant, targets, other), probabilities(constant, targets), atol=0.01)


@pytest.mark.parametrize("damage", ["shape", "nan"])
def test_arrays_that_do_not_fit_are_rejected(problem, damage):
    learned = LogisticRegression.learn(*problem, 0.3)
    arrays = learned.as_arrays("own")
    shape = (COLUMNS + (damage == "shape"), CLASSES)
    arrays["own_weights"] = arrays["own_weights"] * (np.nan if damage == "nan" else 1)
    with pytest.raises(ValueError, match="own"):
        LogisticRegression.from_arrays("own", arrays, shape)
