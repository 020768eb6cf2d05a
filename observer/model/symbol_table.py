"""P(B_bp | M, I): the table of Vector Symbols that the paper learns by counting (section IV.A, (2))."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from observer.model.base import Example
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
