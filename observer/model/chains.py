"""Examples as chains: gaps bridged, laid over phases, what was never shown taken from others."""

import numpy as np
from numpy.typing import NDArray

from observer.tracks import Floats


def bridged(features: Floats) -> Floats:
    """(F, D) -> the same, gaps filled linearly in time, the first frame's motion from the second's.

    A feature that is never seen stays NaN.
    """
    frames = np.arange(len(features))
    result = features.copy()
    for column in result.T:
        seen = np.isfinite(column)
        if seen.any():
            column[~seen] = np.interp(frames[~seen], frames[seen], column[seen])
    return result


def laid_over(features: Floats, phases: int) -> Floats:
    """(F, D) -> (Φ, D), linear between frames."""
    place = np.linspace(0, len(features) - 1, phases)
    before = np.floor(place).astype(int)
    after = np.minimum(before + 1, len(features) - 1)
    share = (place - before)[:, None]
    laid: Floats = features[before] * (1 - share) + features[after] * share
    return laid


def completed(chains: Floats, movement_of: NDArray[np.int64]) -> Floats:
    """(C, Φ, D) -> the same, what a chain never shows taken from its movement's others, or from all."""
    result = chains.copy()
    for chain in np.flatnonzero(~np.isfinite(chains).all(axis=(1, 2))):
        hole = ~np.isfinite(chains[chain])
        for others in (chains[movement_of == movement_of[chain]], chains):
            count = np.isfinite(others).sum(axis=0)
            mean = np.nansum(others, axis=0) / np.maximum(count, 1)
            fill = hole & (count > 0)
            result[chain][fill] = mean[fill]
            hole &= count == 0
        result[chain][hole] = 0.0
    return result
