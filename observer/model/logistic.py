"""Multinomial logistic regression with an L2 penalty, learned by SciPy's L-BFGS. Pure."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import NDArray

from observer.model.base import Arrays, array_in
from observer.tracks import Floats32

Vector = np.ndarray[tuple[int], np.dtype[np.float64]]
LEAST_DECREASE = 2e-5
"""Relative decrease of the loss below which learning stops."""
ITERATIONS, FEW_ITERATIONS = 30, 20
"""Of a model, and of those that only evaluate examples: these lose no accuracy on MSR Action3D, 2 points on nw_ucla."""
LEAST_SPREAD = 0.05
"""Added to a feature's standard deviation: a feature that hardly varies in training must not decide."""


@dataclass(frozen=True, slots=True, eq=False)
class LogisticRegression:
    """P(class | x) = softmax(x W + b).

    weights (D, K), intercepts (K,): of the raw features; the standardisation is folded into them.
    """

    weights: Floats32
    intercepts: Floats32

    @classmethod
    def learn(
        cls,
        features: Floats32,
        targets: Floats32,
        inverse_penalty: float,
        iterations: int = ITERATIONS,
        kinds: Sequence[int] = (),
    ) -> Self:
        """(N, D) features, (N, K) target probabilities.

        inverse_penalty: C of the loss C sum_n CE_n + |W|^2 / 2 on standardised features; intercepts are free.
        kinds: where another kind of features begins. With several kinds CE is the mean of that of all features and of
        those of each kind alone, the others being as usual. Otherwise one kind replaces another, and what that says
        about other people is lost. Neverova, Wolf, Taylor and Nebout, "ModDrop", IEEE TPAMI 38, 2016.
        """
        mean, spread = features.mean(axis=0), features.std(axis=0) + np.float32(LEAST_SPREAD)
        x = features - mean
        x /= spread
        solution = _minimise(_Loss(x, targets, inverse_penalty, kinds), iterations)
        raw = solution[:-1] / spread[:, None]
        return cls(raw, solution[-1] - mean @ raw)

    def log_probabilities(self, features: Floats32) -> Floats32:
        """(..., D) -> (..., K) natural logarithms."""
        scores: Floats32 = features @ self.weights + self.intercepts
        scores -= np.logaddexp.reduce(scores, axis=-1, keepdims=True)
        return scores

    def as_arrays(self, name: str) -> dict[str, NDArray[np.generic]]:
        """For a model file."""
        return {f"{name}_weights": self.weights, f"{name}_intercepts": self.intercepts}

    @classmethod
    def from_arrays(cls, name: str, arrays: Arrays, shape: tuple[int, int]) -> Self:
        """The inverse of `as_arrays`; ValueError for arrays that are not (D, K) = `shape`, or not finite."""
        weights = array_in(arrays, f"{name}_weights", shape, np.float32)
        return cls(weights, array_in(arrays, f"{name}_intercepts", shape[1:], np.float32))


class _Loss:
    def __init__(self, x: Floats32, targets: Floats32, inverse_penalty: float, kinds: Sequence[int] = ()) -> None:
        self.x, self.targets = x, targets
        self._kinds = [slice(*ends) for ends in pairwise((0, *kinds, x.shape[1]))]
        self._weight = np.float32(inverse_penalty / (len(self._kinds) + 1 if kinds else 1))

    def __call__(self, w: Floats32) -> tuple[float, Floats32]:
        """(D + 1, K), intercepts last -> the loss and its gradient."""
        alone = [self.x[:, kind] @ w[kind] for kind in self._kinds]
        answers = [sum(alone), *alone] if len(alone) > 1 else alone
        losses, residuals = zip(*(self._cross_entropy(scores + w[-1]) for scores in answers), strict=True)
        gradient = np.empty_like(w)
        gradient[-1] = sum(residuals).sum(axis=0)
        for kind, own in zip(self._kinds, residuals[-len(alone) :], strict=True):
            residual = residuals[0] + own if len(alone) > 1 else own
            # BLAS computes this order of the product faster than x.T @ ...
            gradient[kind] = (residual.T @ self.x[:, kind]).T + w[kind]
        return sum(losses) + 0.5 * float((w[:-1] * w[:-1]).sum()), gradient

    def _cross_entropy(self, scores: Floats32) -> tuple[float, Floats32]:
        """(N, K) -> its part of the loss, and the gradient (N, K)."""
        scores -= scores.max(axis=1, keepdims=True)
        p = np.exp(scores)
        total = p.sum(axis=1, keepdims=True)
        cross_entropy = np.log(total) - (scores * self.targets).sum(axis=1, keepdims=True)
        p /= total
        p -= self.targets
        p *= self._weight
        return float((self._weight * cross_entropy).sum()), p


def _minimise(loss: _Loss, iterations: int) -> Floats32:
    # Loaded here: a model that only watches needs no SciPy.
    from scipy.optimize import minimize

    shape = (loss.x.shape[1] + 1, loss.targets.shape[1])

    def flat(w: Vector) -> tuple[float, Vector]:
        value, gradient = loss(w.reshape(shape).astype(np.float32))
        return value, gradient.ravel().astype(np.float64)

    # All steps are remembered: as many of them bring it nearer to the optimum than with ten.
    result = minimize(
        flat,
        np.zeros(math.prod(shape)),
        jac=True,
        method="L-BFGS-B",
        options={"maxiter": iterations, "maxcor": iterations, "ftol": LEAST_DECREASE},
    )
    return result.x.reshape(shape).astype(np.float32)
