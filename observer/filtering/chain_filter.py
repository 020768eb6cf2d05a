"""The Bayes filter over movement, facing and phase, with rest before and after (docs/design/model.md). Pure.

A movement is a mixture of *chains* of phases, one for each training example. A person at rest enters a chain near its
beginning, advances through its phases, and leaves it past the last one into the rest after that movement. Chains with
negligible mass are skipped, and phases that no mass can have reached yet.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from observer.tracks import Floats, Floats32, Integers

if TYPE_CHECKING:
    from observer.model.chains import PostureEvidence

FLOOR = -69.0
"""Log of 1e-30: the strongest evidence of a single frame against a state."""
NEGLIGIBLE = 1e-8
"""Share of all mass: a chain with less is skipped until the person rests again, and less mass enters no chain."""
LEAST_LIKELIHOOD = np.float32(math.exp(FLOOR))
CROWDED = 0.75
"""Chains are dropped when fewer than this share of the live ones still count: copying the others costs time too."""


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

    cell_of: (C,) movement * K + facing of each chain; movements M, facings K; phases: of each chain. The prior is
    uniform over movements that have chains, and over the facings of each. negligible: see NEGLIGIBLE; 0 skips nothing.
    """

    def __init__(
        self,
        cell_of: Integers,
        movements: int,
        facings: int,
        phases: int,
        dynamics: Dynamics,
        onset_known: bool,
        negligible: float = NEGLIGIBLE,
    ) -> None:
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
        self._after = np.zeros(movements * facings)
        self._past = np.zeros(movements * facings)
        self._moving = onset_known
        self._begun = not onset_known
        self._still_frames = 0
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

    def step(self, evidence: "PostureEvidence", still: float = 0.0) -> None:
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
            self._settle()
        self._moving = self.rest < 0.5
        self._drop_negligible()

    def _settle(self) -> None:
        """Move all mass to the rest before a movement: a person who is still for this long rests, in any posture.

        No movement ends in the posture that a tracker shows when it takes a hand for the head.
        """
        self._active = np.zeros((len(self._entering), len(self._cell_of)), np.float32)
        self._live, self._before = None, 1.0
        self._after, self._past = np.zeros_like(self._after), np.zeros_like(self._past)

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

    def _condition(self, evidence: "PostureEvidence") -> None:
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
        if not self._negligible:
            return
        rows = np.flatnonzero(self._active.sum(axis=1) > self._negligible)
        width = max(int(rows[-1]) + 1 if len(rows) else 0, len(self._entering))
        self._active = self._active[:width]
        # Arithmetic with numbers near 1e-38 is slow.
        self._active *= self._active >= np.float32(1e-30)
        counts = self._active.sum(axis=0) > self._negligible / len(self._cell_of)
        if counts.sum() < CROWDED * len(counts) and self.rest < 0.5:
            self._live = np.flatnonzero(counts) if self._live is None else self._live[counts]
            self._active = np.ascontiguousarray(self._active[:, counts])
