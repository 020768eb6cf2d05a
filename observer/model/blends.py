"""Blends: half of one movement and half of another is neither, and an example of something else. Pure."""

import numpy as np
from numpy.typing import NDArray

from observer.model.evenly import evenly

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
                others.append(int(strange[int(evenly(place) * len(strange))]))
    return np.array(ones, dtype=np.int64), np.array(others, dtype=np.int64)
