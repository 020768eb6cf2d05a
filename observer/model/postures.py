"""How near an observed posture is to each of many, and what that says: exp(-sharpness d^2), with bounded outliers."""

import numpy as np
from numpy.typing import NDArray

from observer.features.posture import groups_of
from observer.filtering.chain_filter import Indices, Masses
from observer.filtering.phase_filter import FLOOR
from observer.tracks import Floats


class Postures:
    """(Φ, D, C) postures, chain by chain and phase by phase, to which distances are measured frame after frame."""

    def __init__(self, postures: NDArray[np.float32]) -> None:
        # Phases first, chains last: the phases that are reached and the chains that count are a block of memory.
        self._postures = np.ascontiguousarray(postures, np.float32)
        groups = groups_of((postures.shape[1] - 2) // 5)
        self._lengths = np.stack([(self._postures[:, groups == g] ** 2).sum(axis=1) for g in range(groups[-1] + 1)])
        self._length = self._lengths.sum(axis=0)
        self._first_of = np.searchsorted(groups, np.arange(groups[-1] + 1))

    def of(self, chains: Indices) -> "Postures":
        """Those of some chains alone."""
        chosen = object.__new__(Postures)
        chosen._postures = np.ascontiguousarray(self._postures[:, :, chains])
        chosen._lengths, chosen._length = self._lengths[:, :, chains], self._length[:, chains]
        chosen._first_of = self._first_of
        return chosen

    @property
    def bytes(self) -> int:
        """Memory."""
        return int(self._postures.nbytes + self._lengths.nbytes + self._length.nbytes)

    def squared_distances(self, features: Floats, phases: int) -> Masses:
        """(D,) features, NaN where not seen -> (phases, C) squared distances over what is seen, first phases alone.

        |x - o|^2 = |x|^2 - 2 x.o + |o|^2, so that a frame costs one matrix-vector product.
        """
        seen = np.isfinite(features)
        o = np.where(seen, features, 0.0).astype(np.float32)
        # A feature is seen together with its group.
        some = self._lengths[seen[self._first_of], :phases]
        lengths = self._length[:phases] if seen.all() else some.sum(axis=0)
        distances: Masses = lengths - 2 * np.matmul(o, self._postures[:phases]) + np.float32(o @ o)
        return np.maximum(distances, 0, out=distances)


class Chosen:
    """The postures of the chains that count, gathered anew only when those change."""

    def __init__(self, postures: Postures) -> None:
        self._whole = self._chosen = postures
        self._live: Indices | None = None

    def of(self, live: Indices | None) -> Postures:
        """Of these chains; None: of all."""
        if live is not self._live:
            self._chosen = self._whole if live is None else self._whole.of(live)
            self._live = live
        return self._chosen


class PostureEvidence:
    """What one frame's features say.

    of_rest: the postures (1, D, C) in which the chains begin and end, without motion, the chains' cells (C,), which are
    movement * K + facing, and (M, K). outlier: evidence against a posture is at most so many nats beside the nearest:
    one blunder of a tracker, or one odd movement of a hand, must not decide alone.
    """

    def __init__(
        self,
        chosen: "Chosen",
        of_rest: tuple[Postures, Postures, Indices, tuple[int, int]],
        features: Floats,
        sharpness: float,
        outlier: float,
    ) -> None:
        self._chosen, self._features = chosen, features
        self._sharpness, self._outlier = np.float32(sharpness), np.float32(outlier)
        first, last, cell_of, (movements, facings) = of_rest
        begun, ended = (self._likelihood(each) for each in (first, last))
        count = np.maximum(np.bincount(cell_of, minlength=movements * facings), 1)
        own = (np.bincount(cell_of, ended, len(count)) / count).reshape(movements, facings)
        # Who rests faces one way: a mean over all facings would rule rest out.
        facing_of = cell_of % facings
        twice = 2 * np.maximum(np.bincount(facing_of, minlength=facings), 1)
        of_facing = np.bincount(facing_of, begun + ended, facings) / twice
        self._rest = float(of_facing.max())
        self._after = np.maximum(own, of_facing)

    def chains(self, live: Indices | None, phases: int) -> tuple[Masses, float]:
        """(phases, n) exp(-sharpness d^2) + exp(-outlier) · the nearest's, over the nearest's; and ln of that."""
        likelihood = self._chosen.of(live).squared_distances(self._features, phases)
        nearest = likelihood.min()
        likelihood -= nearest
        likelihood *= -self._sharpness
        np.exp(likelihood, out=likelihood)
        likelihood += np.exp(-self._outlier)
        return likelihood, float(-self._sharpness * nearest)

    @property
    def rest(self) -> float:
        """ln of the mean over all postures in which somebody of that facing rested, at the facing where it is most."""
        return float(np.log(max(self._rest, np.exp(FLOOR))))

    @property
    def after(self) -> Floats:
        """(M, K) ln of the mean over those in which the movement ended, where that is more than rest at that facing."""
        after: Floats = np.log(np.maximum(self._after, np.exp(FLOOR)))
        return after

    def _likelihood(self, postures: Postures) -> Floats:
        distances = postures.squared_distances(self._features, 1)[0]
        likelihood: Floats = np.exp(np.maximum(-self._sharpness * distances, np.float32(FLOOR))).astype(np.float64)
        return likelihood
