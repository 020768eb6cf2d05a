"""Training examples as chains of postures, and the likelihood of an observed posture (docs/design/model.md). Pure."""

import copy
import math
from typing import Self

import numpy as np
from numpy.typing import NDArray

from observer.features import groups_of
from observer.filtering.chain_filter import FLOOR
from observer.tracks import Floats, Floats32, Integers


def fill_gaps(features: Floats) -> Floats:
    """(F, D) -> the same, gaps filled linearly in time, ends held; a feature that is never seen stays NaN."""
    frames = np.arange(len(features))
    filled = features.copy()
    for column in filled.T:
        known = np.isfinite(column)
        if known.any():
            column[~known] = np.interp(frames[~known], frames[known], column[known])
    return filled


def complete_chains(chains: Floats, movement_of: Integers) -> Floats:
    """(C, Φ, D) -> the same without NaN: a feature that a chain never shows is the mean of other chains.

    Of those of its movement where they show it, else of all chains, else 0. movement_of: (C,).
    """
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


class Postures:
    """(Φ, D, C) postures by phase, feature and chain, to which the distances of each frame are computed."""

    def __init__(self, postures: NDArray[np.float32]) -> None:
        # Phases first, chains last: the phases that are reached and the chains that count are a block of memory.
        self._postures = np.ascontiguousarray(postures, np.float32)
        groups = groups_of((postures.shape[1] - 2) // 5)
        self._lengths = np.stack([(self._postures[:, groups == g] ** 2).sum(axis=1) for g in range(groups[-1] + 1)])
        self._length = self._lengths.sum(axis=0)
        self._first_of = np.searchsorted(groups, np.arange(groups[-1] + 1))
        self._chosen: tuple[Postures, Integers] | None = None
        self._copied = len(postures)

    def select(self, chains: Integers) -> "Postures":
        """The postures of these chains only. Those of a phase are copied when it is first reached."""
        selected = copy.copy(self)
        selected._postures = np.empty((*self._postures.shape[:2], len(chains)), np.float32)
        selected._lengths, selected._length = self._lengths[:, :, chains], self._length[:, chains]
        selected._chosen, selected._copied = (self, chains), 0
        return selected

    def _copy(self, phases: int) -> None:
        if self._chosen is not None and self._copied < phases:
            (whole, chains), rows = self._chosen, slice(self._copied, phases)
            np.take(whole._postures[rows], chains, axis=2, out=self._postures[rows], mode="clip")
            self._copied = phases

    def squared_distances(self, features: Floats, phases: int) -> Floats32:
        """(D,) features, NaN where not seen -> (phases, C) squared distances over what is seen, of the first phases.

        |x - o|^2 = |x|^2 - 2 x.o + |o|^2, so that a frame costs one matrix-vector product.
        """
        self._copy(phases)
        known = np.isfinite(features)
        whole = bool(known.all())
        o = (features if whole else np.where(known, features, 0.0)).astype(np.float32)
        # A feature is seen together with its group.
        lengths = self._length[:phases] if whole else self._lengths[known[self._first_of], :phases].sum(axis=0)
        distances: Floats32 = np.matmul(np.float32(-2) * o, self._postures[:phases])
        distances += lengths
        distances += np.float32(o @ o)
        return np.maximum(distances, 0, out=distances)


class RestPostures:
    """The postures in which chains begin and end, without motion: those of people who rest before and after a movement.

    first, last: (C, D). cell_of: (C,) movement * K + facing of each chain; shape: M, K.
    """

    def __init__(self, first: Floats, last: Floats, cell_of: Integers, shape: tuple[int, int]) -> None:
        self._postures, self._shape = Postures(np.concatenate([first, last]).T[None]), shape
        cells, facings = shape[0] * shape[1], shape[1]
        chains, facing_of = np.arange(len(cell_of)), cell_of % facings
        # Rows of weights: the mean over the last postures of each cell, then over all postures of each facing.
        self._means = np.zeros((cells + facings, 2 * len(chains)), np.float32)
        self._means[cell_of, len(chains) + chains] = 1 / np.bincount(cell_of)[cell_of]
        self._means[cells + facing_of, chains] = 0.5 / np.bincount(facing_of)[facing_of]
        self._means[cells:, len(chains) :] = self._means[cells:, : len(chains)]

    def log_likelihoods(self, features: Floats, sharpness: float) -> tuple[float, Floats]:
        """(D,) features -> the two logarithms of `PostureEvidence`, rest and after."""
        likelihood = self._postures.squared_distances(features, 1)[0]
        likelihood *= np.float32(-sharpness)
        np.exp(likelihood, out=likelihood)
        means = (self._means @ likelihood).astype(np.float64)
        np.maximum(means, math.exp(FLOOR), out=means)
        # A person at rest faces one way; a mean over all facings would rule rest out.
        own, of_facing = means[: -self._shape[1]].reshape(self._shape), means[-self._shape[1] :]
        return math.log(of_facing.max()), np.log(np.maximum(own, of_facing))


class PostureEvidence:
    """The likelihood of the newest frame's features for every chain, phase and rest, which a `ChainFilter` takes in.

    outlier: the largest evidence in nats against a posture compared with the nearest one, so that one error of a
    tracker or one odd movement of a hand does not decide alone.
    rest: log of the mean likelihood over the postures at rest of one facing, for the facing where it is largest.
    after: (M, K) log of the mean likelihood over the movement's last postures, at least that of rest at the facing.
    """

    rest: float
    after: Floats

    def __init__(self, postures: Postures, at_rest: RestPostures, sharpness: float, outlier: float) -> None:
        self._postures, self._at_rest, self._sharpness = postures, at_rest, sharpness
        self._least = np.float32(math.exp(-outlier))
        self._live: Integers | None = None
        self._of_live = postures

    def see(self, features: Floats) -> Self:
        """One more frame: (D,) features, NaN where not seen."""
        self._features = features
        self.rest, self.after = self._at_rest.log_likelihoods(features, self._sharpness)
        return self

    def chains(self, live: Integers | None, phases: int) -> tuple[Floats32, float]:
        """(phases, n) likelihoods relative to the nearest posture's, plus exp(-outlier); and the log of its own.

        live: the chains that count; None: all.
        """
        if live is not self._live:
            self._live, self._of_live = live, self._postures if live is None else self._postures.select(live)
        likelihood = self._of_live.squared_distances(self._features, phases)
        nearest = likelihood.min()
        likelihood -= nearest
        likelihood *= np.float32(-self._sharpness)
        np.exp(likelihood, out=likelihood)
        likelihood += self._least
        return likelihood, -self._sharpness * float(nearest)
