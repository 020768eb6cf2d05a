"""How the prior of the stacker's weights is learned: the hierarchical model is recovered from tasks drawn from it."""

import numpy as np
import pytest

from benchmarks.stacker import curvature, gaussians_over
from observer.model.stacker import CONTEXT, MEMBERS, ElseLoss, Instants, LabelLoss

TASKS, SHAPE = 60, (6, 4)


class OwnLoss(ElseLoss):
    """Rows of three weights, the others being 0 all the time."""

    def __init__(self, x, target):
        self.x, self._target, self.weights = x, target, np.ones(len(target))


def drawn(rng, spread, rows=400):
    """Tasks of six sets; the first weight is twice the task's size, the second 1, give or take `spread`."""
    tasks = np.stack([np.ones(TASKS), rng.uniform(0, 1, TASKS)], axis=1)
    losses = []
    for size in tasks[:, 1]:
        weights = np.zeros(SHAPE).ravel()
        weights[:2] = rng.normal([2 * size, 1.0], spread)
        x = np.zeros((rows, weights.size))
        x[:, :2] = rng.normal(size=(rows, 2))
        losses.append(OwnLoss(x, (rng.random(rows) < 1 / (1 + np.exp(-x @ weights))).astype(float)))
    return tasks, losses, np.array([str(n % 6) for n in range(TASKS)])


@pytest.mark.parametrize("spread", [0.2, 1.0])
def test_means_and_spreads_are_those_from_which_tasks_were_drawn(spread):
    tasks, losses, sets = drawn(np.random.default_rng(7), spread)
    gaussians = gaussians_over(tasks, losses, sets, np.zeros(SHAPE))
    mean = gaussians.at(np.array([1.0, 0.5])).ravel()
    assert mean[:2] == pytest.approx([1.0, 1.0], abs=0.1 + spread / 3)
    assert gaussians.spreads.ravel()[:2] == pytest.approx(spread, rel=0.35)
    assert mean[2:] == pytest.approx(0.0), "what no task shows stays without weight"
    assert gaussians.spreads.ravel()[2:].min() > 0.9, "and free"


def test_curvature_is_the_second_derivative():
    rng = np.random.default_rng(1)
    x = rng.normal(size=(40, 6))
    of_else = OwnLoss(x, rng.random(40))
    of_else.weights = rng.uniform(0.1, 2, 40)
    members, context = rng.normal(size=(40, len(MEMBERS), 4)), rng.normal(size=(40, len(CONTEXT)))
    instants = Instants(members, context, np.zeros(40), np.zeros(40), np.zeros((40, 2, 4)))
    of_labels = LabelLoss(instants, rng.integers(0, 4, 40), rng.uniform(0.1, 2, 40))
    for loss, size in ((of_else, 6), (of_labels, len(MEMBERS) * len(CONTEXT))):
        weights, step = rng.normal(0, 0.2, size), 1e-5
        differences = [(loss(weights + step * e)[1] - loss(weights - step * e)[1]) / (2 * step) for e in np.eye(size)]
        np.testing.assert_allclose(curvature(loss, weights), differences, atol=1e-5)
