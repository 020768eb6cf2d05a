"""The Bayes filter over movement and phase, with rest before and after, written down plainly (docs/design/model.md):
the oracle of `observer/model/chain_filter.py:ChainFilter`."""

import numpy as np
from numpy.typing import NDArray

from observer.model.chain_filter import FLOOR, Dynamics
from observer.tracks import Floats

NEGLIGIBLE = 1e-150
"""Masses below this are set to 0: they decide nothing, and arithmetic with numbers near 1e-308 is slow."""


class PhaseFilter:
    """P(movement, phase | frames so far). movement_of: (C,) the movement of each chain; phases: Φ of each; prior: (M,)
    P(M). With `onset_known` the movement begins with the first frame; otherwise the person is at rest or, with the
    probability `under_way`, in any phase."""

    def __init__(
        self, movement_of: NDArray[np.int64], phases: int, prior: Floats, dynamics: Dynamics, onset_known: bool
    ) -> None:
        self._movement_of, self._dynamics, self._prior = movement_of, dynamics, prior
        chains = np.bincount(movement_of, minlength=len(prior))
        self._chain_prior = prior[movement_of] / chains[movement_of]
        self._active = np.zeros((len(movement_of), phases))
        self._before = 0.0 if onset_known else 1.0 - dynamics.under_way
        self._after = np.zeros(len(prior))
        if onset_known:
            self._enter(1.0)
        else:
            self._active += dynamics.under_way / phases * self._chain_prior[:, None]
        self._begun = not onset_known

    @property
    def p(self) -> Floats:
        """(M,) P(M): movements in progress or just ended; the rest before any movement is spread as the prior."""
        active = np.bincount(self._movement_of, self._active.sum(axis=1), minlength=len(self._prior))
        mass = active + self._after + self._before * self._prior
        p: Floats = mass / mass.sum()
        return p

    @property
    def rest(self) -> float:
        """P(at rest now), before a movement or after one."""
        return float(min(self._before + self._after.sum(), 1.0))

    def step(self, log_evidence: Floats, log_rest: float, log_after: Floats | None = None, still: float = 0.0) -> None:
        """One frame: (C, Φ) log P(observation | chain, phase), and log P(observation | rest). log_after: (M,) the same
        for the rest after each movement, if it differs from the rest before any movement. still: P(the person is
        still)."""
        if self._begun:
            self._predict(self._dynamics.forget, self._dynamics.abandon * still)
        self._begun = True
        self._condition(log_evidence, log_rest, np.full(len(self._prior), log_rest) if log_after is None else log_after)

    def step_blind(self) -> None:
        """One frame in which no part was seen: time passes, and the posterior moves towards the prior (section I).
        Every movement loses the same share, so that the entropy never falls; to forget only the movements that have
        ended would be evidence for the others."""
        if self._begun:
            self._predict(forget=0.0, abandon=0.0)
        self._begun = True
        doubt = self._dynamics.forget
        self._before += doubt * (self._active.sum() + self._after.sum())
        self._active *= 1 - doubt
        self._after *= 1 - doubt

    def _predict(self, forget: float, abandon: float) -> None:
        d = self._dynamics
        moved, left = self._active * d.steps[0], np.zeros(len(self._active))
        for k, share in enumerate(d.steps[1:], 1):
            moved[:, k:] += share * self._active[:, :-k]
            left += share * self._active[:, -k:].sum(axis=1)
        self._active = moved
        given_up = abandon * self._active.sum()
        self._active *= 1 - abandon
        self._after += np.bincount(self._movement_of, left, minlength=len(self._prior))
        forgotten = forget * self._after
        self._after -= forgotten
        begun = d.begin * self._before
        self._before += forgotten.sum() + given_up - begun
        self._enter(begun)

    def _enter(self, mass: float) -> None:
        entry = self._dynamics.entry
        self._active[:, : len(entry)] += mass * self._chain_prior[:, None] * entry

    def _condition(self, log_evidence: Floats, log_rest: float, log_after: Floats) -> None:
        top = max(float(log_evidence.max()), log_rest, float(log_after.max()))
        self._active *= np.exp(np.maximum(log_evidence - top, FLOOR))
        self._before *= float(np.exp(max(log_rest - top, FLOOR)))
        self._after *= np.exp(np.maximum(log_after - top, FLOOR))
        total = self._active.sum() + self._before + self._after.sum()
        self._active /= total
        self._active[self._active < NEGLIGIBLE] = 0.0
        self._before /= total
        self._after /= total
