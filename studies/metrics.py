"""How good judgements are: accuracy, confusion, calibration. Pure functions on arrays.

Shapes: p (N, M) judged probabilities, truth (N,) indices of the true movements.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

BINS = 15
LEAST_P = 1e-12
"""A movement held for impossible that happened would cost infinitely; it costs 27.6 nats."""


def accuracy(p: Floats, truth: Indices) -> float:
    """Share of trials whose most probable movement is the true one (MAP, section IV.B)."""
    return float((p.argmax(axis=1) == truth).mean())


def confusion(p: Floats, truth: Indices) -> Indices:
    """(M, M) counts, rows true, columns judged."""
    counts = np.zeros((p.shape[1], p.shape[1]), dtype=np.int64)
    np.add.at(counts, (truth, p.argmax(axis=1)), 1)
    return counts


def expected_calibration_error(p: Floats, truth: Indices, bins: int = BINS) -> float:
    """Mean |accuracy - confidence| over equal bins of the confidence max p, weighed by the trials in each."""
    confidence, right = p.max(axis=1), p.argmax(axis=1) == truth
    # A confidence of exactly 1 belongs to the last bin.
    place = np.minimum((confidence * bins).astype(int), bins - 1)
    gaps = [
        (place == b).mean() * abs(right[place == b].mean() - confidence[place == b].mean())
        for b in range(bins)
        if (place == b).any()
    ]
    return float(sum(gaps))


def brier(p: Floats, truth: Indices) -> float:
    """Mean over trials of sum_m (p_m - [m is true])^2: 0 perfect, 2 sure and wrong."""
    target = np.eye(p.shape[1])[truth]
    return float(((p - target) ** 2).sum(axis=1).mean())


def log_loss(p: Floats, truth: Indices) -> float:
    """Mean of -ln p(true movement), in nats."""
    return float(-np.log(np.maximum(p[np.arange(len(p)), truth], LEAST_P)).mean())
