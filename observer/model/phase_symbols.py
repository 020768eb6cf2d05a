"""`phase-symbols`: the paper's table, freed from the frame clock by a Bayes filter over phase and speed."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from common.probability import uniform
from observer.features.space import SpaceReader, VectorSymbol
from observer.filtering.phase_filter import Dynamics, PhaseFilter
from observer.model.base import Onset
from observer.model.frame_table import SYMBOLS, SymbolTable, log_evidence
from observer.tracks import Floats, Tracks

STILL_AT_REST = 0.9
"""P(O | rest) for each part; the other eight symbols share the remainder. Expert wisdom, as the paper calls it."""


def tempo_dynamics(mean_speed: float, given: Mapping[str, float]) -> Dynamics:
    """V speeds in phases a frame, geometric from slowest to fastest times `mean_speed`; a step v is floor or ceil."""
    count = int(given["speeds"])
    speeds = (
        np.full(1, mean_speed) if count == 1 else mean_speed * np.geomspace(given["slowest"], given["fastest"], count)
    )
    whole = np.floor(speeds).astype(int)
    steps = np.zeros((count, whole.max() + 2))
    rows = np.arange(count)
    steps[rows, whole] = 1 - (speeds - whole)
    steps[rows, whole + 1] = speeds - whole
    jitter = np.eye(count)
    if count > 1:
        # A tenth of the mass drifts to the neighbouring speeds each frame.
        jitter = 0.9 * np.eye(count) + 0.05 * np.eye(count, k=1) + 0.05 * np.eye(count, k=-1)
        jitter /= jitter.sum(axis=1, keepdims=True)
    entry = np.array([1.0])
    return Dynamics(steps, np.full(count, 1 / count), jitter, entry, given["begin"], given["forget"])


class PhaseSymbols(SymbolTable):
    """One chain of phases a movement, P(b | m, phase) counted with every example laid over the phases."""

    kind: ClassVar[str] = "phase-symbols"
    DEFAULTS: ClassVar[Mapping[str, float]] = {
        "phases": 30.0,
        "threshold": 0.16,
        "smoothing": 0.1,
        # Chosen on training subjects: matters with few examples, hardly with many (docs/guide/own-movements.md).
        "neighbours": 10.0,
        "temperature": 4.0,
        "speeds": 10.0,
        "slowest": 0.5,
        "fastest": 2.0,
        "begin": 0.05,
        "forget": 0.01,
    }
    BINS = "phases"

    def watch(self, onset: Onset) -> "_PhaseSymbolsWatch":
        """Start the filter at rest, or at the first phase where the onset is known."""
        given = self.header.parameters
        movements, phases = self.log_table.shape[:2]
        dynamics = tempo_dynamics(phases / self.mean_frames, given)
        belief = PhaseFilter(np.arange(movements), phases, uniform(movements), dynamics, onset.known)
        reader = SpaceReader(self.header.body_parts, given["threshold"])
        return _PhaseSymbolsWatch(self.log_table, 1 / given["temperature"], reader, belief)


class FilterWatch:
    """The belief of a model's watch that filters: what it believes is what its filter believes."""

    def __init__(self, belief: PhaseFilter) -> None:
        self.belief = belief

    @property
    def p(self) -> Floats:
        """(M,) posterior over movements."""
        return self.belief.p

    @property
    def joint(self) -> Floats | None:
        """It knows one facing alone."""
        return None

    @property
    def foreseen(self) -> Floats | None:
        """Not known."""
        return None

    @property
    def unlearned(self) -> Floats | None:
        """Not known."""
        return None

    @property
    def rest(self) -> float:
        """P(at rest now)."""
        return self.belief.rest


class _PhaseSymbolsWatch(FilterWatch):
    def __init__(self, log_table: Floats, exponent: float, reader: SpaceReader, belief: PhaseFilter) -> None:
        super().__init__(belief)
        self._log_table, self._exponent, self._reader = log_table, exponent, reader
        self._log_rest = np.full(SYMBOLS, np.log((1 - STILL_AT_REST) / (SYMBOLS - 1)))
        self._log_rest[VectorSymbol.O] = np.log(STILL_AT_REST)

    def update(self, tracks: Tracks) -> None:
        symbols = self._reader.update(tracks)
        seen = symbols[symbols >= 0]
        if not len(seen):
            self.belief.step_blind()
            return
        log_rest = float(self._log_rest[seen].sum())
        self.belief.step(self._exponent * log_evidence(self._log_table, symbols), self._exponent * log_rest)
