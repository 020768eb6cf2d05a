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


def learn_table(
    sequences: Sequence[tuple[Symbols, int]], movements: int, bins: int, smoothing: float, neighbours: float = 0.0
) -> Floats:
    """(M, I, P, 9) log P(b | m, i), by counting over (symbols (F, P), movement) with Dirichlet smoothing.

    neighbours: so many counts more, spread as in the bins before and after: with few examples a bin of its own knows
    little; 0 is the paper's table. A symbol NOT_SEEN is not counted; what was never counted stays uniform.
    """
    parts = sequences[0][0].shape[1]
    counts = np.full((movements, bins, parts, SYMBOLS), smoothing)
    for symbols, movement in sequences:
        frame, part = np.nonzero(symbols >= 0)
        np.add.at(counts[movement], (indices(len(symbols), bins)[frame], part, symbols[frame, part]), 1.0)
    if neighbours:
        beside = np.full(counts.shape, smoothing)
        beside[:, 1:] += counts[:, :-1] - smoothing
        beside[:, :-1] += counts[:, 1:] - smoothing
        counts += neighbours * beside / beside.sum(axis=-1, keepdims=True)
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

    DEFAULTS holds `threshold`, `smoothing`, `neighbours` and, under the name BINS, how many bins there are.
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
        bins, movements = int(given[cls.BINS]), header.vocabulary.size
        table = learn_table(sequences, movements, bins, given["smoothing"], given["neighbours"])
        return cls(header, table, float(np.mean([len(e.tracks) for e in examples])))

    def grown(self, header: Header, examples: Sequence[Example]) -> Self:
        """The same for a vocabulary with more movements at its end, of which alone the examples are."""
        table = type(self).learn(header, examples).log_table[self.header.vocabulary.size :]
        return type(self)(header, np.concatenate([self.log_table, table]), self.mean_frames)

    def shrunk(self, header: Header, kept: Sequence[int]) -> Self:
        """The same for a vocabulary of only these movements, in their order."""
        return type(self)(header, self.log_table[list(kept)], self.mean_frames)

    @classmethod
    def from_arrays(cls, header: Header, arrays: Arrays) -> Self:
        """From log_table (M, I, P, 9) and mean_frames ()."""
        return cls(header, np.asarray(arrays["log_table"], dtype=np.float64), float(arrays["mean_frames"]))

    def arrays(self) -> Arrays:
        """log_table (M, I, P, 9) and mean_frames ()."""
        return {"log_table": self.log_table, "mean_frames": np.array(self.mean_frames)}
