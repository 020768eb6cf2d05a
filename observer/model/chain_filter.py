"""The Bayes filter over movement, facing and phase, with rest before and after (docs/design/model.md). Pure.

A movement is a mixture of *chains* of phases, one for each training example. A person at rest enters a chain near its
beginning, advances through its phases, and leaves it past the last one into the rest after that movement. Chains with
negligible mass are skipped, and phases that no mass can have reached yet.
"""

import copy
import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from observer.features import groups_of
from observer.tracks import Floats, Floats32, Integers

FLOOR = -69.0
"""Log of 1e-30: the strongest evidence of a single frame against a state."""
NEGLIGIBLE = 1e-8
"""Share of all mass: a chain with less is skipped until the person rests again, and less mass enters no chain."""
LEAST_LIKELIHOOD = np.float32(math.exp(FLOOR))
CROWDED = 0.75
"""Chains are dropped when fewer than this share of the live ones still count: copying the others costs time too."""


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

    def __init__(self, postures: Postures, at_rest: RestPostures, sharpness: float, outlier: float) -> None:
        self._postures, self._at_rest, self._sharpness = postures, at_rest, sharpness
        self._least = np.float32(math.exp(-outlier))
        self._live: Integers | None = None
        self._of_live, self.rest, self.after = postures, 0.0, np.zeros(0)

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


@dataclass(frozen=True)
class Dynamics:
    """How a person moves through a chain, by frames.

    steps: (K,) P(advance by k phases). entry: (S,) P(enter at phase s). begin: P(leave rest). forget: P(the rest after
    a movement becomes plain rest), and the share of probability that returns to the prior without any visible part.
    abandon: P(a movement is given up | the person is still). settled: number of still frames in a row after which the
    person certainly rests. under_way: P(a movement is in progress before the first frame), in any phase, if the onset
    is not known.
    """

    steps: Floats
    entry: Floats
    begin: float
    forget: float
    abandon: float = 0.0
    settled: float = math.inf
    under_way: float = 0.0


class ChainFilter:
    """P(movement, facing, phase | frames so far).

    cell_of: (C,) movement * K + facing of each chain; shape: M, K and the phases of each chain. The prior is uniform
    over movements that have chains, and over the facings of each. negligible: see NEGLIGIBLE; 0 skips nothing.
    """

    def __init__(
        self,
        cell_of: Integers,
        shape: tuple[int, int, int],
        dynamics: Dynamics,
        onset_known: bool,
        negligible: float = NEGLIGIBLE,
    ) -> None:
        movements, facings, phases = shape
        self._cell_of, self._shape, self._phases = cell_of, (movements, facings), phases
        self._dynamics, self._negligible = dynamics, negligible
        # (Φ + K - 1, Φ): where each phase's mass goes; the last rows leave the chain.
        rows = phases + len(dynamics.steps) - 1
        self._advance: Floats32 = np.zeros((rows, phases), np.float32)
        for k, share in enumerate(dynamics.steps):
            self._advance += np.float32(share) * np.eye(rows, phases, -k, np.float32)
        count = np.bincount(cell_of, minlength=movements * facings)
        self._prior = (count > 0) / max(int((count > 0).sum()), 1)
        of_chain = self._prior[cell_of] / count[cell_of]
        self._entering = np.outer(dynamics.entry, of_chain).astype(np.float32)
        self._live: Integers | None = None
        self._active: Floats32 = self._entering.copy()
        self._before = 0.0
        if not onset_known:
            self._before = 1.0 - dynamics.under_way
            # Without such mass only the first phases are computed.
            shown = phases if dynamics.under_way else len(dynamics.entry)
            self._active = np.tile(np.float32(dynamics.under_way / phases * of_chain), (shown, 1))
        self._after, self._past = np.zeros(movements * facings), np.zeros(movements * facings)
        self._moving, self._begun, self._still_frames = onset_known, not onset_known, 0
        # The posterior is read several times per frame, and is a sum over all active mass.
        self._posterior: Floats | None = None

    @property
    def posterior(self) -> Floats:
        """(M, K) P(movement, facing): in progress or just ended; the rest before any movement is spread as the prior.

        While the person moves, the previous movement has no mass. Otherwise two observers that are each half sure that
        a new movement has begun would together be sure of the previous one.
        """
        if self._posterior is None:
            done = np.maximum(self._after - self._past, 0.0) if self._moving else self._after
            mass = self._cells(self._active.sum(axis=0)) + done + self._before * self._prior
            self._posterior = (mass / mass.sum()).reshape(self._shape)
        return self._posterior.copy()

    @property
    def rest(self) -> float:
        """P(at rest now), before a movement or after one."""
        return float(min(self._before + self._after.sum(), 1.0))

    def step(self, evidence: PostureEvidence, still: float = 0.0) -> None:
        """One frame; still: P(the person is still)."""
        self._posterior = None
        if not self._moving:
            self._past = self._after.copy()
        if self._begun:
            self._predict(self._dynamics.forget, self._dynamics.abandon * still)
        self._begun = True
        self._condition(evidence)
        self._still_frames = self._still_frames + 1 if still >= 0.5 else 0
        if self._still_frames >= self._dynamics.settled and self.rest < 0.5:
            # In any posture: no movement ends in the one that a tracker shows when it takes a hand for the head.
            self._active = np.zeros((len(self._entering), len(self._cell_of)), np.float32)
            self._live, self._before = None, 1.0
            self._after, self._past = np.zeros_like(self._after), np.zeros_like(self._past)
        self._moving = self.rest < 0.5
        if self._negligible:
            self._drop_negligible()

    def step_blind(self) -> None:
        """One frame in which no part was seen: time passes, and all movements lose the same share to the prior."""
        self._posterior = None
        if self._begun:
            self._predict(0.0, 0.0)
        self._begun = True
        doubt = self._dynamics.forget
        self._before += doubt * float(self._active.sum() + self._after.sum())
        self._active *= np.float32(1 - doubt)
        self._after *= 1 - doubt
        self._past *= 1 - doubt

    def _cells(self, of_chains: NDArray[np.floating]) -> Floats:
        cell_of = self._cell_of if self._live is None else self._cell_of[self._live]
        return np.bincount(cell_of, of_chains, minlength=len(self._after)).astype(np.float64, copy=False)

    def _predict(self, forget: float, abandon: float) -> None:
        old, furthest = self._active, len(self._active) + len(self._advance) - self._phases
        new = self._advance[: min(furthest, self._phases), : len(old)] @ old
        given_up = abandon * float(new.sum())
        new *= np.float32(1 - abandon)
        self._active = new
        if furthest > self._phases:
            self._after += self._cells(self._advance[self._phases :, : len(old)].sum(axis=0) @ old)
        forgotten = forget * self._after
        self._after -= forgotten
        self._past *= 1 - forget
        # Mass that returns to plain rest in this frame can enter a movement in the next at the earliest.
        begun = self._dynamics.begin * self._before
        self._before += float(forgotten.sum()) + given_up
        if begun > self._negligible or not self._negligible:
            self._enter(begun)

    def _enter(self, mass: float) -> None:
        if self._live is not None:
            whole = np.zeros((len(self._active), len(self._cell_of)), np.float32)
            whole[:, self._live] = self._active
            self._live, self._active = None, whole
        self._before -= mass
        self._active[: len(self._entering)] += np.float32(mass) * self._entering

    def _condition(self, evidence: PostureEvidence) -> None:
        likelihood, log_scale = evidence.chains(self._live, len(self._active))
        log_after = evidence.after.ravel()
        top = max(log_scale, evidence.rest, log_after.max())
        likelihood *= np.float32(math.exp(max(log_scale - top, FLOOR)))
        self._active *= np.maximum(likelihood, LEAST_LIKELIHOOD, out=likelihood)
        self._before *= math.exp(max(evidence.rest - top, FLOOR))
        of_rest = np.exp(np.maximum(log_after - top, FLOOR))
        self._after *= of_rest
        self._past *= of_rest
        total = float(self._active.sum() + self._after.sum()) + self._before
        self._active /= np.float32(total)
        self._before /= total
        self._after /= total
        self._past /= total

    def _drop_negligible(self) -> None:
        rows = np.flatnonzero(self._active.sum(axis=1) > self._negligible)
        width = max(int(rows[-1]) + 1 if len(rows) else 0, len(self._entering))
        self._active = self._active[:width]
        # Arithmetic with numbers near 1e-38 is slow.
        self._active *= self._active >= np.float32(1e-30)
        counts = self._active.sum(axis=0) > self._negligible / len(self._cell_of)
        if counts.sum() < CROWDED * len(counts) and self.rest < 0.5:
            self._live = np.flatnonzero(counts) if self._live is None else self._live[counts]
            self._active = np.ascontiguousarray(self._active[:, counts])
