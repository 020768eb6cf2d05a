"""The distance of a movement from the nearest take that was learned, as evidence for something else. Pure.

A regression that has seen five takes of each movement hardly knows what else there is. But takes of one movement are
alike: a movement that is farther from every take of its label than these are from each other is something else. The
distance is that of dynamic time warping (Sakoe and Chiba, IEEE Transactions on Acoustics, Speech, and Signal
Processing 26, 1978, symmetric form), from the begin of the movement to any instant of a take, so that a movement in
progress is near too:

    D(i, j) = min(D(i - 1, j) + d(i, j), D(i, j - 1) + d(i, j), D(i - 1, j - 1) + 2 d(i, j))     mean: D(i, j) / (i + j)

d: root mean square of the 2 P differences of two frames, body sizes. A *relative* distance is in units of the mean
distance between the movement's own takes.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from observer.model.base import Example
from observer.model.body_trace import relative_and_path
from observer.model.even_spread import evenly_spread
from observer.tracks import Floats, Floats32

MOST_TAKES = 60
"""A frame is compared with so many takes, as many of each movement: with more the regressions know enough, and
comparing would take longer than they do."""
COMPARED_FROM = 0.4
"""The share of a take from which on a movement in progress is compared with it."""
USUAL_DISTANCE = 0.3
"""Body sizes from a take to the nearest of two others of its movement: the mean over MSR Action3D (.14), karate (.28)
and Northwestern-UCLA (.39), 15 parts."""


@dataclass(frozen=True, slots=True, eq=False)
class NearestTakes:
    """The takes of the movements. paths: (K, G, 2 P) places since the begin in body sizes, zeros after lengths (K,).

    movements: (K,) indices. scales: (M,) mean distance of each movement's takes from their nearest one.
    """

    paths: Floats32
    lengths: NDArray[np.int64]
    movements: NDArray[np.int64]
    scales: Floats
    squares: Floats32 = field(init=False)
    """(K, G) squared lengths of the paths: |x - y|^2 = |x|^2 - 2 x.y + |y|^2, so that a frame costs one product."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "squares", np.einsum("kgp,kgp->kg", self.paths, self.paths))

    @classmethod
    def of(cls, examples: Sequence[Example], movements: int, scales: Floats | None = None) -> "NearestTakes | None":
        """At most MOST_TAKES of the takes among the examples, whose features are traces.

        None for a model of several facings, and for fewer than two takes. scales: as learned earlier; otherwise they
        are measured by leaving out one take at a time.
        """
        takes = _representative([e for e in examples if e.movement >= 0 and e.features is not None])
        if len(takes) < 2 or any(e.facing for e in examples):
            return None
        traces = [e.features.astype(np.float32) for e in takes if e.features is not None]
        paths = [path_of(trace) for trace in traces]
        lengths = np.array([len(path) for path in paths])
        padded = np.zeros((len(paths), int(lengths.max()), paths[0].shape[1]), np.float32)
        for row, path in zip(padded, paths, strict=True):
            row[: len(path)] = path
        shown = np.array([e.movement for e in takes])
        if scales is not None:
            return cls(padded, lengths, shown, scales)
        unscaled = cls(padded, lengths, shown, np.ones(movements))
        return cls(padded, lengths, shown, unscaled._scales(traces))

    def _scales(self, traces: Sequence[Floats32]) -> Floats:
        """(M,) by leaving out one take at a time."""
        nearest: list[list[float]] = [[] for _ in self.scales]
        for k in range(len(traces)):
            own = self.movements == self.movements[k]
            own[k] = False
            if own.any():
                watch = NearestTakeWatch(self, traces[k])
                nearest[self.movements[k]].append(float(watch.distances[own].min()))
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
        self._frames = 0
        self._costs: Floats = np.full(takes.paths.shape[:2], np.inf)
        places = np.arange(takes.paths.shape[1])
        reachable = (places >= COMPARED_FROM * takes.lengths[:, None] - 1) & (places < takes.lengths[:, None])
        self._unreachable = np.where(reachable, 0.0, np.inf)
        self._steps = places + 2.0
        self.distances: Floats = np.full(len(takes.lengths), np.inf)
        """(K,) mean distance from each take along the best path so far, in body sizes."""
        for row in rows:
            self.step(row)

    def step(self, row: Floats32) -> None:
        """One more frame: (2 P + 3,) a row of the trace."""
        if self._begin is None:
            self._begin = row[-3:-1]
        path = row[:-3] + np.tile(row[-3:-1] - self._begin, (len(row) - 3) // 2)
        squares = self._takes.paths @ (np.float32(-2) * path)
        squares += self._takes.squares + path @ path
        cost = np.sqrt(np.maximum(squares, 0.0) / np.float32(len(path)), dtype=np.float64)
        entered = self._costs + cost
        np.minimum(entered[:, 1:], self._costs[:, :-1] + 2 * cost[:, 1:], out=entered[:, 1:])
        if not self._frames:
            entered[:, 0] = 2 * cost[:, 0]
        # Within a row, D(j) = min over k <= j of entered(k) + cost(k + 1) + ... + cost(j): a running minimum.
        total = np.cumsum(cost, axis=1)
        self._costs = total + np.minimum.accumulate(entered - total, axis=1)
        self.distances = (self._costs / (self._steps + self._frames) + self._unreachable).min(axis=1)
        self._frames += 1

    @property
    def relative_distances(self) -> Floats:
        """(M,) relative distance from the nearest take of each movement; inf while it cannot be compared."""
        nearest = np.full(len(self._takes.scales), np.inf)
        np.minimum.at(nearest, self._takes.movements, self.distances)
        distances: Floats = nearest / self._takes.scales
        return distances


def _representative(takes: Sequence[Example]) -> list[Example]:
    """At most MOST_TAKES, as many of each movement as of the others, and evenly from their order."""
    numbers: dict[int, int] = {}
    ranked = []
    for n, take in enumerate(takes):
        number = numbers[take.movement] = numbers.get(take.movement, -1) + 1
        ranked.append((evenly_spread(number), n))
    counts = Counter(take.movement for take in takes)
    share = min(1.0, MOST_TAKES / len(takes)) if takes else 1.0
    chosen = []
    for movement, count in counts.items():
        own = sorted((rank, n) for rank, n in ranked if takes[n].movement == movement)
        chosen += [n for _, n in own[: max(round(share * count), 1)]]
    return [takes[n] for n in sorted(chosen)]


def path_of(trace: Floats32) -> Floats32:
    """(F, 2 P + 3) trace from the begin of a movement -> (F, 2 P) where each part is since then."""
    _, path = relative_and_path(trace)
    return path - np.tile(trace[0, -3:-1], path.shape[1] // 2)
