"""How fast a board's corners move through the pictures of a video; pure."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from observer.geometry.projection import Floats

Shot = tuple[int, NDArray[np.intp], Floats]
"""Number of the picture, (N,) ids of the corners, (N, 2) pixels."""


def speeds(shots: Sequence[Shot], step: int) -> list[Floats]:
    """For each shot (N, 2) pixels from picture to picture, `step` numbers apart, by its neighbours.

    A corner that neither neighbour has moves as the others do on average; a shot without neighbours does not move.
    """
    known = {number: dict(zip(ids.tolist(), pixels, strict=True)) for number, ids, pixels in shots}
    return [_of(shot, [known.get(shot[0] + away, {}) for away in (-step, 0, step)]) for shot in shots]


def _of(shot: Shot, neighbours: list[dict[int, Floats]]) -> Floats:
    _, ids, pixels = shot
    result = np.full_like(pixels, np.nan)
    for n, corner in enumerate(ids.tolist()):
        places = [(at, found[corner]) for at, found in enumerate(neighbours) if corner in found]
        (first, begin), (last, end) = places[0], places[-1]
        if last > first:
            result[n] = (end - begin) / (last - first)
    unknown = np.isnan(result[:, 0])
    result[unknown] = 0.0 if unknown.all() else result[~unknown].mean(axis=0)
    return result
