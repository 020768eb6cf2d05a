"""The distance of a movement from the nearest take that was learned, as evidence for something else. Pure.

Takes of one movement are alike: a movement that is farther from every take of its label than these are from each other
is something else. Dynamic time warping as in `observer.score.comparison`, but to any instant of a take, so that a
movement in progress is near too; d is the root mean square of the 2 P differences of two frames, body sizes. A
*relative* distance is in units of the mean distance between the movement's own takes.
"""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from observer.features import relative_and_path
from observer.model.base import Example, evenly_spread
from observer.tracks import Floats, Floats32

MOST_TAKES = 60
"""A frame is compared with so many takes, as many of each movement: with more the regressions know enough, and
comparing would take longer than they do."""
COMPARED_FROM = 0.4
"""The share of a take from which on a movement in progress is compared with it."""
USUAL_DISTANCE = 0.3
"""Body sizes from a take to the nearest of two others of its movement: the mean over MSR Action3D (.14), karate (.28)
and Northwestern-UCLA (.39), 15 parts."""


@dataclass(frozen=True, eq=False)
class NearestTakes:
    """The takes of the movements. paths: (K, G, 2 P) places since the begin in body sizes, zeros after lengths (K,).

    movements: (K,) indices. scales: (M,) mean distance of each movement's takes from their nearest one. hop: every so
    many-th frame is compared.
    """

    paths: Floats32
    lengths: NDArray[np.int64]
    movements: NDArray[np.int64]
    scales: Floats
    hop: int = 1

    @cached_property
    def squares(self) -> Floats32:
        """(K, G) mean squares of the paths: |x - y|^2 = |x|^2 - 2 x.y + |y|^2, so that a frame costs one product."""
        squares: Floats32 = np.einsum("kgp,kgp->kg", self.paths, self.paths) / np.float32(self.paths.shape[2])
        return squares

    @classmethod
    def of(
        cls, examples: Sequence[Example], movements: int, scales: Floats | None = None, hop: int = 1
    ) -> "NearestTakes | None":
        """At most MOST_TAKES of the takes among the examples, whose features are traces.

        None for a model of several facings, and for fewer than two takes. scales: as learned earlier; otherwise they
        are measured by leaving out one take at a time.
        """
        takes = _representative([e for e in examples if e.movement >= 0])
        if len(takes) < 2 or any(e.facing for e in examples):
            return None
        traces = [e.features.astype(np.float32) for e in takes]
        # Where the parts are since the begin.
        parts = traces[0].shape[1] // 2 - 1
        paths = [(relative_and_path(trace)[1] - np.tile(trace[0, -3:-1], parts))[::hop] for trace in traces]
        lengths = np.array([len(path) for path in paths])
        padded = np.zeros((len(paths), int(lengths.max()), paths[0].shape[1]), np.float32)
        for row, path in zip(padded, paths, strict=True):
            row[: len(path)] = path
        shown = np.array([e.movement for e in takes])
        if scales is not None:
            return cls(padded, lengths, shown, scales, hop)
        unscaled = cls(padded, lengths, shown, np.ones(movements), hop)
        return replace(unscaled, scales=unscaled._scales(traces))

    def _scales(self, traces: Sequence[Floats32]) -> Floats:
        """(M,) by leaving out one take at a time."""
        nearest = list[list[float]]()
        for movement in range(len(self.scales)):
            rows = np.flatnonzero(self.movements == movement)
            own = NearestTakes(self.paths[rows], self.lengths[rows], self.movements[rows], self.scales, self.hop)
            # To itself a take has the distance 0.
            distances = (np.delete(NearestTakeWatch(own, traces[k]).distances, n) for n, k in enumerate(rows.tolist()))
            nearest.append([float(others.min()) for others in distances if len(others)])
        usual = _shrunk([distance for distances in nearest for distance in distances], USUAL_DISTANCE)
        return np.array([_shrunk(distances, usual) for distances in nearest])


def _shrunk(distances: Sequence[float], usual: float) -> float:
    """Their mean with the usual distance as one of them: few takes can be alike by chance."""
    return (sum(distances) + usual) / (len(distances) + 1)


class NearestTakeWatch:
    """Compares one movement with all takes, frame by frame from its begin."""

    def __init__(self, takes: NearestTakes, rows: Iterable[Floats32] = ()) -> None:
        """rows: (2 P + 3,) of the trace since the begin."""
        self._takes = takes
        self._begin: Floats32 | None = None
        self._seen = 0
        self._sums: Floats32 = np.full(takes.paths.shape[:2], np.inf, np.float32)
        places = np.arange(takes.paths.shape[1])
        reachable = (places >= COMPARED_FROM * takes.lengths[:, None] - 1) & (places < takes.lengths[:, None])
        self._unreachable = np.where(reachable, np.float32(0.0), np.float32(np.inf))
        self._steps = (places + 1).astype(np.float32)
        for row in rows:
            self.step(row)

    def step(self, row: Floats32) -> None:
        """One more frame: (2 P + 3,) a row of the trace."""
        self._seen += 1
        if (self._seen - 1) % self._takes.hop:
            return
        if self._begin is None:
            self._begin = row[-3:-1]
        path: Floats32 = (row[:-3].reshape(-1, 2) + (row[-3:-1] - self._begin)).ravel()
        cost = self._takes.paths @ (path * np.float32(-2 / len(path)))
        cost += self._takes.squares
        cost += path @ path / np.float32(len(path))
        np.sqrt(np.maximum(cost, 0.0, out=cost), out=cost)
        self._sums = np.cumsum(cost, axis=1) + cost[:, :1] if self._seen == 1 else next_sums(self._sums, cost)

    @property
    def distances(self) -> Floats:
        """(K,) mean distance from each take along the best path so far, in body sizes."""
        compared = np.float32((self._seen - 1) // self._takes.hop + 1)
        result: Floats = (self._sums / (self._steps + compared) + self._unreachable).min(axis=1).astype(np.float64)
        return result

    @property
    def relative_distances(self) -> Floats:
        """(M,) relative distance from the nearest take of each movement; inf while it cannot be compared."""
        nearest = np.full(len(self._takes.scales), np.inf)
        np.minimum.at(nearest, self._takes.movements, self.distances)
        return nearest / self._takes.scales


def next_sums(sums: Floats32, cost: Floats32) -> Floats32:
    """(K, G) D(i - 1, j), sums along the shortest paths, and (K, G) d(i, j) -> (K, G) D(i, j); symmetric form."""
    total, entered = np.cumsum(cost, axis=1), sums.copy()
    np.minimum(sums[:, 1:], sums[:, :-1] + cost[:, 1:], out=entered[:, 1:])
    # Within a row, D(j) = min over k <= j of entered(k) + cost(k + 1) + ... + cost(j): a running minimum.
    entered[:, 1:] -= total[:, :-1]
    np.minimum.accumulate(entered, axis=1, out=entered)
    entered += total
    return entered


def _representative(takes: Sequence[Example]) -> list[Example]:
    """At most MOST_TAKES, as many of each movement as of the others, and evenly from their order."""
    of_movement = defaultdict[int, list[int]](list)
    for n, take in enumerate(takes):
        of_movement[take.movement].append(n)
    share, chosen = min(1.0, MOST_TAKES / max(len(takes), 1)), list[int]()
    for own in of_movement.values():
        spread = sorted(range(len(own)), key=evenly_spread)
        chosen += [own[k] for k in spread[: max(round(share * len(own)), 1)]]
    return [takes[n] for n in sorted(chosen)]
