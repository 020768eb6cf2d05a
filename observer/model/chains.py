"""Examples as chains: gaps bridged, laid over phases, what was never shown taken from others."""

import numpy as np
from numpy.typing import NDArray

from observer.model.base import evenly_spread
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


Indices = NDArray[np.int64]


def pairs_to_blend(movement_of: Indices, facing_of: Indices) -> tuple[Indices, Indices]:
    """(C,) and (C,) -> (B,) and (B,): each chain, and one of another movement at the same facing; always the same.

    Where there are several facings, of each only every second chain: the others are blended at the facings beside it.
    """
    several = len(facing_of) > 0 and facing_of.max() > 0
    ones: list[int] = []
    others: list[int] = []
    for facing in np.unique(facing_of):
        here = np.flatnonzero(facing_of == facing)
        for place, one in enumerate(here):
            strange = here[movement_of[here] != movement_of[one]]
            if len(strange) and not (several and (place + facing) % 2):
                ones.append(int(one))
                others.append(int(strange[int(evenly_spread(place) * len(strange))]))
    return np.array(ones, dtype=np.int64), np.array(others, dtype=np.int64)
