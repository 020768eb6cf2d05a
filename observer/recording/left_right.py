"""Left and right that a camera's tracker has exchanged, found by what the other cameras see. Pure."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from observer.geometry.projection import Floats, project
from observer.tracks import other_side


def pairs_in(body_parts: Sequence[str]) -> list[tuple[int, int]]:
    """The rows of left and right parts, left_hand and right_hand and so on."""
    others = enumerate(other_side(body_parts))
    return [(row, other) for row, other in others if body_parts[row].startswith("left_") and other != row]


def exchanged_back(
    matrices: Sequence[Floats], centres: Floats, positions: Floats, pairs: Sequence[tuple[int, int]], gate_px: float
) -> tuple[Floats, NDArray[np.int64]]:
    """Centres (K, P, N, 2) and positions (K, P, 3) -> the centres with left and right put right, and counts (N,).

    A camera has exchanged a pair of parts at an instant if the squared distances of both centres from the images of
    the positions, each at most `gate_px`, sum to less by more than gate_px² when they are exchanged. The counts are the
    pairs that each camera had exchanged.
    """
    result, counts = centres.copy(), np.zeros(len(matrices), dtype=np.int64)
    for n, matrix in enumerate(matrices):
        image = project(matrix, positions)
        for left, right in pairs:
            pair = centres[:, [left, right], n]
            straight, crossed = (_cost(pair[:, rows], image[:, [left, right]], gate_px) for rows in ([0, 1], [1, 0]))
            wrong = straight - crossed > gate_px**2
            result[wrong, left, n], result[wrong, right, n] = pair[wrong, 1], pair[wrong, 0]
            counts[n] += int(wrong.sum())
    return result, counts


def _cost(centres: Floats, image: Floats, gate_px: float) -> Floats:
    """(K, 2, 2) twice -> (K,) sum of the squared distances, each at most gate_px²; NaN where one is not known."""
    cost: Floats = np.minimum(((centres - image) ** 2).sum(axis=-1), gate_px**2).sum(axis=-1)
    return cost
