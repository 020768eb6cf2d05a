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

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from observer.model.base import Arrays, Example, Header
from observer.model.body_trace import relative_and_path
from observer.model.parameters import Parameter, ParameterRange
from observer.tracks import Floats, Floats32

WEIGHT = "nearest_weight"
NEAREST: Mapping[str, Parameter] = {WEIGHT: Parameter(2.0, ParameterRange(0.0, 20.0), earlier=0.0)}
"""Nats for each unit of relative distance above USUAL_DISTANCE."""
SCALES = "take_scales"
"""Name of the scales in a model file."""
MOST_TAKES = 60
"""With more takes the regressions know enough, and comparing with all would take too long."""
USUAL_DISTANCE = 1.2
"""Relative distance from which a movement is more likely something else than the regressions say."""
MOST_NATS = 6.0
"""A near movement is no evidence at all: it may still be the begin of another one."""
COMPARED_FROM = 0.4
"""The share of a take from which on a movement in progress is compared with it."""
OWN_SHARE = 0.5
"""The weight of a movement's own mean distance beside that of all movements: few takes can be alike by chance."""


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
        """The takes among the examples, whose features are traces; None unless they are 2 to MOST_TAKES at facing 0.

        scales: as learned earlier; otherwise they are measured by leaving out one take at a time.
        """
        takes = [e for e in examples if e.movement >= 0 and e.features is not None]
        if not 2 <= len(takes) <= MOST_TAKES or any(e.facing for e in takes):
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
        measured = unscaled._scales(traces)
        return None if measured is None else cls(padded, lengths, shown, measured)

    def _scales(self, traces: Sequence[Floats32]) -> Floats | None:
        """(M,) by leaving out one take at a time; None if no movement has two takes, or if they are all the same."""
        nearest: list[list[float]] = [[] for _ in self.scales]
        for k in range(len(traces)):
            own = self.movements == self.movements[k]
            own[k] = False
            if own.any():
                watch = NearestTakeWatch(self, traces[k])
                nearest[self.movements[k]].append(float(watch.distances[own].min()))
        of_all = [distance for distances in nearest for distance in distances]
        if not of_all or not np.mean(of_all) > 0:
            return None
        usual = float(np.mean(of_all))
        means = np.array([np.mean(distances) if distances else usual for distances in nearest])
        return OWN_SHARE * means + (1 - OWN_SHARE) * usual


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

    def nats(self, movement: int, weight: float) -> float:
        """Evidence for something else where this movement is the likeliest: 0 to MOST_NATS.

        It is `weight` times the relative distance above USUAL_DISTANCE; 0 for a movement without takes.
        """
        distance = float(self.relative_distances[movement])
        if not self._frames or not (self._takes.movements == movement).any():
            return 0.0
        return min(max(weight * (distance - USUAL_DISTANCE), 0.0), MOST_NATS)


def takes_of(header: Header, examples: Sequence[Example], scales: Floats | None) -> NearestTakes | None:
    """The takes with which a model compares movements; None if it compares with none.

    scales: those in its file, empty for a model that does not compare with takes; None: measured here.
    """
    if not header.parameters[WEIGHT] or (scales is not None and not len(scales)):
        return None
    return NearestTakes.of(examples, header.vocabulary.size, scales)


def held_out_distances(
    header: Header, examples: Sequence[Example], folds: Iterable[Sequence[int]], shares: Sequence[float]
) -> dict[int, Floats]:
    """Index of each example of a movement -> (T, M) `NearestTakeWatch.relative_distances` from takes of other folds.

    The T distances are those after these shares of the movement; inf where too few takes are left.
    """
    result = {}
    for fold in folds:
        left_out = set(fold)
        takes = takes_of(header, [e for n, e in enumerate(examples) if n not in left_out], None)
        for n in fold:
            trace = examples[n].features
            if examples[n].movement >= 0 and trace is not None:
                frames = [max(math.ceil(share * len(trace)), 1) for share in shares]
                distances = None if takes is None else _distances_after(takes, trace.astype(np.float32), frames)
                result[n] = np.full((len(shares), header.vocabulary.size), np.inf) if distances is None else distances
    return result


def _distances_after(takes: NearestTakes, trace: Floats32, frames: Sequence[int]) -> Floats:
    watch, result = NearestTakeWatch(takes), []
    for row in trace:
        watch.step(row)
        result.append(watch.relative_distances)
    return np.array([result[n - 1] for n in frames])


def arrays_of(takes: NearestTakes | None) -> Arrays:
    """For a model file, which has the takes as examples already."""
    return {SCALES: np.zeros(0) if takes is None else takes.scales}


def scales_in(arrays: Arrays, movements: int) -> Floats:
    """`NearestTakes.scales` of a model file, empty for a model without; ValueError if they do not fit."""
    scales = np.asarray(arrays.get(SCALES, np.zeros(0)), np.float64)
    if scales.shape not in ((0,), (movements,)) or not (np.isfinite(scales) & (scales > 0)).all():
        raise ValueError(f"{SCALES} are {scales}; {movements} distances are expected")
    return scales


def path_of(trace: Floats32) -> Floats32:
    """(F, 2 P + 3) trace from the begin of a movement -> (F, 2 P) where each part is since then."""
    _, path = relative_and_path(trace)
    return path - np.tile(trace[0, -3:-1], path.shape[1] // 2)
