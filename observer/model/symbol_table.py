"""P(B_bp | M, I): the table of Vector Symbols that the paper learns by counting (section IV.A, (2))."""

from collections.abc import Mapping, Sequence
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from observer.model.base import Arrays, Example, Header, with_defaults
from observer.space import SpaceReader, Symbols
from observer.tracks import Floats

SYMBOLS = 9


def symbols_of(example: Example, body_parts: Sequence[str], threshold: float) -> Symbols:
    """(F, P) Vector Symbols of an example, read as an observer would read them."""
    reader = SpaceReader(body_parts, threshold)
    return np.array([reader.update(tracks) for tracks in example.tracks])


def indices(frames: int, bins: int) -> NDArray[np.int64]:
    """(frames,) the bin i of each frame n when a movement of that many frames is laid over I = bins: floor(n I / F)."""
    return np.arange(frames) * bins // max(frames, 1)


def learn_table(sequences: Sequence[tuple[Symbols, int]], movements: int, bins: int, smoothing: float) -> Floats:
    """(M, I, P, 9) log P(b | m, i), by counting over (symbols (F, P), movement) with Dirichlet smoothing.

    A symbol NOT_SEEN is not counted; what was never counted stays uniform.
    """
    parts = sequences[0][0].shape[1]
    counts = np.full((movements, bins, parts, SYMBOLS), smoothing)
    for symbols, movement in sequences:
        frame, part = np.nonzero(symbols >= 0)
        np.add.at(counts[movement], (indices(len(symbols), bins)[frame], part, symbols[frame, part]), 1.0)
    log_table: Floats = np.log(counts / counts.sum(axis=-1, keepdims=True))
    return log_table


def log_evidence(log_table: Floats, symbols: Symbols) -> Floats:
    """(..., P, 9) log table and (P,) symbols -> (...) sum over parts of log P(b_bp | ...).

    A part NOT_SEEN contributes factor 1: "uniformly distributed descriptors" (section I).
    """
    seen = np.flatnonzero(symbols >= 0)
    evidence: Floats = log_table[..., seen, symbols[seen]].sum(axis=-1)
    return evidence


class SymbolTable:
    """What the models of Vector Symbols share: the table, learned by counting, and how it is kept.

    DEFAULTS holds `threshold`, `smoothing` and, under the name BINS, how many bins a movement is laid over.
    """

    DEFAULTS: ClassVar[Mapping[str, float]]
    BINS: ClassVar[str]

    def __init__(self, header: Header, log_table: Floats, mean_frames: float) -> None:
        self.header = header
        self.log_table = log_table
        self.mean_frames = mean_frames

    @classmethod
    def learn(cls, header: Header, examples: Sequence[Example]) -> Self:
        """Count Vector Symbols per movement, bin and part."""
        header = with_defaults(header, cls.DEFAULTS)
        given = header.parameters
        sequences = [(symbols_of(e, header.body_parts, given["threshold"]), e.movement) for e in examples]
        table = learn_table(sequences, header.vocabulary.size, int(given[cls.BINS]), given["smoothing"])
        return cls(header, table, float(np.mean([len(e.tracks) for e in examples])))

    @classmethod
    def from_arrays(cls, header: Header, arrays: Arrays) -> Self:
        """From log_table (M, I, P, 9) and mean_frames ()."""
        return cls(header, np.asarray(arrays["log_table"], dtype=np.float64), float(arrays["mean_frames"]))

    def arrays(self) -> Arrays:
        """log_table (M, I, P, 9) and mean_frames ()."""
        return {"log_table": self.log_table, "mean_frames": np.array(self.mean_frames)}
