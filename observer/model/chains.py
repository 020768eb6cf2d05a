"""Training examples as chains of phases: fills gaps, resamples to a fixed number of phases, and blends chains."""

import numpy as np
from numpy.typing import NDArray

from observer.model.base import evenly_spread
from observer.tracks import Floats

Indices = NDArray[np.int64]


def fill_gaps(features: Floats) -> Floats:
    """(F, D) -> the same, gaps filled linearly in time, ends held; a feature that is never seen stays NaN."""
    frames = np.arange(len(features))
    filled = features.copy()
    for column in filled.T:
        known = np.isfinite(column)
        if known.any():
            column[~known] = np.interp(frames[~known], frames[known], column[known])
    return filled


def resample_phases(features: Floats, phases: int) -> Floats:
    """(F, D) -> (Φ, D), linear between frames."""
    place = np.linspace(0, len(features) - 1, phases)
    before = np.floor(place).astype(int)
    after = np.minimum(before + 1, len(features) - 1)
    share = (place - before)[:, None]
    chain: Floats = features[before] * (1 - share) + features[after] * share
    return chain


def complete_chains(chains: Floats, movement_of: Indices) -> Floats:
    """(C, Φ, D) -> the same; features that a chain never shows are means of its movement's other chains, or of all."""
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


def blend_pairs(movement_of: Indices, facing_of: Indices) -> tuple[Indices, Indices]:
    """(C,) and (C,) -> (B,) and (B,): pairs of chains of different movements at the same facing; deterministic.

    The mean of such a pair is neither movement, and so an example of "something else". With several facings only every
    second chain of each facing is paired; the others are paired at the neighbouring facings.
    """
    several = len(facing_of) > 0 and facing_of.max() > 0
    ones: list[int] = []
    others: list[int] = []
    for facing in np.unique(facing_of):
        here = np.flatnonzero(facing_of == facing)
        for place, one in enumerate(here):
            different = here[movement_of[here] != movement_of[one]]
            if len(different) and not (several and (place + facing) % 2):
                ones.append(int(one))
                others.append(int(different[int(evenly_spread(place) * len(different))]))
    return np.array(ones, dtype=np.int64), np.array(others, dtype=np.int64)
