"""Aligns a performance with many takes at once: dynamic time warping over the whole of both. Pure.

Sakoe and Chiba, IEEE Transactions on Acoustics, Speech, and Signal Processing 26, 1978, symmetric form:

    D(i, j) = min(D(i - 1, j) + d(i, j), D(i, j - 1) + d(i, j), D(i - 1, j - 1) + 2 d(i, j))     mean: D(F, G) / (F + G)
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from observer.tracks import Floats, Floats32, Integers


class Alignment:
    """A performance (F, P, 2) beside K takes (G_k, P, 2), places in body sizes.

    distances: (K,) mean distance along the best path, of root mean squares over all parts.
    """

    def __init__(self, performance: Floats32, takes: Sequence[Floats32]) -> None:
        self._lengths: NDArray[np.int64] = np.array([len(take) for take in takes])
        frames, width = len(performance), performance.shape[1] * 2
        padded = np.zeros((len(takes), int(self._lengths.max()), width), np.float32)
        for row, take in zip(padded, takes, strict=True):
            row[: len(take)] = take.reshape(len(take), -1)
        flat = performance.reshape(frames, -1).astype(np.float32)
        squares = np.einsum("kgp,kgp->kg", padded, padded)
        cost = squares[None] + (flat**2).sum(axis=1)[:, None, None] - 2 * np.tensordot(flat, padded, (1, 2))
        self._sums = _shortest(np.sqrt(np.maximum(cost, 0.0) / width))
        ends = self._sums[-1, np.arange(len(takes)), self._lengths - 1]
        self.distances: Floats = (ends / (self._lengths + frames)).astype(np.float64)
        self._paths: dict[int, Integers] = {}

    def path(self, take: int) -> Integers:
        """(L, 2) frames of the performance and of a take that belong together, from the first to the last ones."""
        if take not in self._paths:
            self._paths[take] = self._path(take)
        return self._paths[take]

    def _path(self, take: int) -> Integers:
        sums: list[list[float]] = self._sums[:, take].tolist()
        i, j = len(sums) - 1, int(self._lengths[take]) - 1
        steps = [(i, j)]
        while i and j:
            both, own, other = sums[i - 1][j - 1], sums[i - 1][j], sums[i][j - 1]
            i, j = (i - 1, j - 1) if both <= min(own, other) else (i - 1, j) if own <= other else (i, j - 1)
            steps.append((i, j))
        steps += [(n, 0) for n in range(i - 1, -1, -1)] + [(0, n) for n in range(j - 1, -1, -1)]
        return np.array(steps[::-1])


class AlignmentPart:
    """An alignment beside some of its takes, (N,) their indices."""

    def __init__(self, alignment: Alignment, takes: Sequence[int]) -> None:
        self._alignment, self._takes = alignment, takes
        self.distances: Floats = alignment.distances[list(takes)]

    def path(self, take: int) -> Integers:
        """As that of the alignment."""
        return self._alignment.path(self._takes[take])


Align = Callable[[Floats32, Sequence[Floats32]], Alignment | AlignmentPart]
"""Aligns a performance with takes."""


def _shortest(cost: Floats32) -> Floats32:
    """(F, K, G) sums along the shortest paths, of costs of the same shape."""
    sums = np.empty_like(cost)
    sums[0] = np.cumsum(cost[0], axis=1)
    for i in range(1, len(cost)):
        # Within a row, D(j) = min over k <= j of entered(k) + cost(k + 1) + ... + cost(j): a running minimum.
        total, before = np.cumsum(cost[i], axis=1), sums[i - 1]
        entered = before.copy()
        np.minimum(before[:, 1:], before[:, :-1] + cost[i][:, 1:], out=entered[:, 1:])
        entered[:, 1:] -= total[:, :-1]
        np.minimum.accumulate(entered, axis=1, out=entered)
        sums[i] = entered + total
    return sums
