"""`phase-symbols`: the paper's table with a Bayes filter over phase and speed instead of the frame clock."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from common.errors import BadInput
from common.probability import uniform
from observer.features.space import SpaceReader, VectorSymbol
from observer.filtering.phase_filter import Dynamics, PhaseFilter
from observer.model.base import NOT_NEGATIVE, POSITIVE, PROBABILITY, Onset, ParameterRange
from observer.model.frame_table import MOST_BINS, SYMBOLS, SymbolTable, log_evidence
from observer.tracks import Floats, Tracks

STILL_AT_REST = 0.9
"""P(O | rest) for each part; the other eight symbols share the remainder. Expert knowledge, as in the paper."""
MOST_SPEEDS = 100


def tempo_dynamics(mean_speed: float, parameters: Mapping[str, float]) -> Dynamics:
    """V speeds in phases per frame, geometric from slowest to fastest times `mean_speed`; a step is floor or ceil."""
    count, slowest, fastest = int(parameters["speeds"]), parameters["slowest"], parameters["fastest"]
    if fastest < slowest:
        raise BadInput(f"parameter fastest = {fastest:g}: a number not below slowest = {slowest:g} is expected")
    speeds = np.full(1, mean_speed) if count == 1 else mean_speed * np.geomspace(slowest, fastest, count)
    whole = np.floor(speeds).astype(int)
    steps = np.zeros((count, whole.max() + 2))
    rows = np.arange(count)
    steps[rows, whole] = 1 - (speeds - whole)
    steps[rows, whole + 1] = speeds - whole
    jitter = np.eye(count)
    if count > 1:
        # In each frame a tenth of the mass moves to the neighbouring speeds.
        jitter = 0.9 * np.eye(count) + 0.05 * np.eye(count, k=1) + 0.05 * np.eye(count, k=-1)
        jitter /= jitter.sum(axis=1, keepdims=True)
    entry = np.array([1.0])
    return Dynamics(steps, np.full(count, 1 / count), jitter, entry, parameters["begin"], parameters["forget"])


class PhaseSymbols(SymbolTable):
    """One chain of phases per movement; P(b | m, phase) is counted with every example divided into the phases."""

    kind: ClassVar[str] = "phase-symbols"
    DEFAULTS: ClassVar[Mapping[str, float]] = {
        "phases": 30.0,
        "threshold": 0.16,
        "smoothing": 0.1,
        # Chosen on training subjects: it matters with few examples and hardly with many (docs/guide/own-movements.md).
        "neighbours": 10.0,
        "temperature": 4.0,
        "speeds": 10.0,
        "slowest": 0.5,
        "fastest": 2.0,
        "begin": 0.05,
        "forget": 0.01,
    }
    RANGES: ClassVar[Mapping[str, ParameterRange]] = {
        "phases": ParameterRange(1, MOST_BINS, whole=True),
        "threshold": NOT_NEGATIVE,
        "smoothing": POSITIVE,
        "neighbours": NOT_NEGATIVE,
        "temperature": POSITIVE,
        "speeds": ParameterRange(1, MOST_SPEEDS, whole=True),
        "slowest": ParameterRange(0.0, 100.0, above=True),
        "fastest": ParameterRange(0.0, 100.0, above=True),
        "begin": PROBABILITY,
        "forget": PROBABILITY,
    }
    BINS = "phases"

    def watch(self, onset: Onset) -> "_PhaseSymbolsWatch":
        """Start the filter at rest, or at the first phase if the onset is known."""
        parameters = self.header.parameters
        movements, phases = self.log_table.shape[:2]
        dynamics = tempo_dynamics(phases / self.mean_frames, parameters)
        phase_filter = PhaseFilter(np.arange(movements), phases, uniform(movements), dynamics, onset.known)
        reader = SpaceReader(self.header.body_parts, parameters["threshold"])
        return _PhaseSymbolsWatch(self.log_table, 1 / parameters["temperature"], reader, phase_filter)


class _PhaseSymbolsWatch:
    """Knows one facing and nothing about "something else"."""

    joint = None
    foreseen = None
    unlearned = None

    def __init__(self, log_table: Floats, exponent: float, reader: SpaceReader, phase_filter: PhaseFilter) -> None:
        self._log_table, self._exponent, self._reader, self._filter = log_table, exponent, reader, phase_filter
        self._log_rest = np.full(SYMBOLS, np.log((1 - STILL_AT_REST) / (SYMBOLS - 1)))
        self._log_rest[VectorSymbol.O] = np.log(STILL_AT_REST)

    @property
    def p(self) -> Floats:
        return self._filter.p

    @property
    def rest(self) -> float:
        return self._filter.rest

    def update(self, tracks: Tracks) -> None:
        symbols = self._reader.update(tracks)
        moved = symbols[symbols >= 0]
        if not len(moved):
            self._filter.step_blind()
            return
        log_rest = float(self._log_rest[moved].sum())
        self._filter.step(self._exponent * log_evidence(self._log_table, symbols), self._exponent * log_rest)
