"""Weights: how much each observer's opinion counts, from its entropy. Pure functions, (N,) bits -> (N,) weights.

The paper says "weighted by certainty" and gives no formula (section V.B); inverse entropy is this project's
reading, after Misra, Bourlard and Tyagi, "New entropy based combination rules in HMM/ANN multi-stream ASR",
ICASSP 2003, who also give the two thresholds.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ENTROPY_FLOOR_BITS = 0.01
"""A one-hot posterior has H = 0 and would weigh infinitely; no judge is surer than this."""
UNSURE_BITS = 10_000.0
"""The entropy that Misra et al. give to a stream beyond the threshold, so that it hardly counts."""


def inverse_entropy(entropies: Floats, floor_bits: float = ENTROPY_FLOOR_BITS) -> Floats:
    """w_i = (1/H_i) / sum_j (1/H_j), with H_i not below `floor_bits`."""
    inverse = 1.0 / np.maximum(entropies, floor_bits)
    weights: Floats = inverse / inverse.sum()
    return weights


def inverse_entropy_static_threshold(entropies: Floats, threshold_bits: float = 1.0) -> Floats:
    """IEST: as inverse_entropy, but an observer with H_i > `threshold_bits` hardly counts."""
    return inverse_entropy(np.where(entropies > threshold_bits, UNSURE_BITS, entropies))


def inverse_entropy_average_threshold(entropies: Floats) -> Floats:
    """IEAT: as inverse_entropy, but an observer less certain than the average of all hardly counts."""
    # Equal entropies differ from their own mean by a rounding error, which must not silence anybody.
    beyond = entropies > entropies.mean() * (1 + 1e-12)
    return inverse_entropy(np.where(beyond, UNSURE_BITS, entropies))


def minimum_entropy(entropies: Floats) -> Floats:
    """The most certain observer counts alone; equally certain ones share."""
    first = entropies <= entropies.min() + 1e-12
    weights: Floats = first / first.sum()
    return weights


def equal(entropies: Floats) -> Floats:
    """Everybody counts the same."""
    return np.full(len(entropies), 1.0 / len(entropies))


def capped(weights: Floats, most: float) -> Floats:
    """No weight above `most`; what is cut off goes to the others in proportion. (N,) summing to 1 -> the same.

    `most` at or below 1/N leaves no choice but equal weights.
    """
    if most * len(weights) <= 1.0:
        return equal(weights)
    result = weights.copy()
    full = np.zeros(len(weights), dtype=bool)
    # Each round fills at least one more observer to the brim, so N rounds suffice.
    for _ in range(len(weights)):
        over = (result > most) & ~full
        if not over.any():
            break
        full |= over
        result[full] = most
        free = result[~full]
        room = 1.0 - most * full.sum()
        share = free / free.sum() if free.sum() > 0 else np.full(len(free), 1.0 / max(len(free), 1))
        result[~full] = room * share
    return result
