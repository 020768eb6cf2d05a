"""`frame-table`: the paper's own model of Laban's Space as Vector Symbols, (1) to (6) to the letter.

Vector Symbols discard position and magnitude. The model must be told where a movement begins and ends.
"""

import math
from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from common.probability import softmax
from observer.features import BodySize
from observer.model.base import Arrays, Example, Header, Onset, Watch, array_in, with_defaults
from observer.model.parameters import Parameter, Positive
from observer.tracks import Floats, Tracks

Symbols = NDArray[np.int8]


class VectorSymbol(IntEnum):
    """The nine values of B in the order of (1), clockwise from up: R is image right, U is image up.

    NOT_SEEN is none of the nine: the motion is unknown, so that all nine are equally likely. O is seen to be
    still.
    """

    NOT_SEEN = -1
    O = 0  # noqa: E741 - the paper's letter
    U = 1
    UR = 2
    R = 3
    DR = 4
    D = 5
    DL = 6
    L = 7
    UL = 8


def vector_symbols(displacements: Floats, size: float, threshold: float) -> Symbols:
    """(..., 2) displacements in the image, v down -> (...) int8 symbols (section III.A).

    Bins of 45° centred on the axes. Displacements shorter than threshold * size are O; size: the body's, in the
    displacements' unit. NOT_SEEN where a displacement is NaN, and everywhere while the size is NaN (not known yet).
    """
    finite: NDArray[np.bool_] = np.isfinite(displacements)
    known = np.logical_and.reduce(finite, axis=-1, keepdims=True) & math.isfinite(size)
    du, dv = np.moveaxis(np.where(known, displacements, 0.0), -1, 0)
    length = np.hypot(du, dv)
    # Without the second condition a threshold of 0 would give stillness a direction.
    still = (length < threshold * size) | (length == 0)
    eighths_from_up = np.rint(np.arctan2(du, -dv) / (math.pi / 4)) % 8
    moved = np.where(still, VectorSymbol.O, VectorSymbol.U + eighths_from_up)
    return np.where(known[..., 0], moved, VectorSymbol.NOT_SEEN).astype(np.int8)


class SpaceReader:
    """Reads Space from a stream of tracks: one Vector Symbol per body part and frame.

    body_parts: names of the P parts. threshold: shortest motion that counts as one, as a share of the performer's
    size; it depends on the frame rate and is fitted on training subjects.
    """

    def __init__(self, body_parts: Sequence[str], threshold: float) -> None:
        self._body_parts = tuple(body_parts)
        self._threshold = threshold
        self._size = BodySize()
        self._last: Floats | None = None

    def update(self, tracks: Tracks) -> Symbols:
        """(P,) symbols of the motion since the frame before; NOT_SEEN for a part that was missing now or then.

        All are NOT_SEEN in the first frame, and until a hand was seen together with the head.
        """
        size = self._size.update(tracks.centres, self._body_parts)
        displacements = tracks.centres - (np.nan if self._last is None else self._last)
        self._last = tracks.centres.copy()
        return vector_symbols(displacements, size, self._threshold)


VECTOR_SYMBOLS = len(VectorSymbol) - 1
"""Those of (1), without NOT_SEEN."""


def bin_indices(frames: int, bins: int) -> NDArray[np.int64]:
    """(frames,) the bin i of each frame n if a movement of that many frames is divided into I bins: floor(n I / F)."""
    return np.arange(frames) * bins // max(frames, 1)


def learn_table(sequences: Sequence[tuple[Symbols, int]], movements: int, bins: int, smoothing: float) -> Floats:
    """(M, I, P, 9) log P(b | m, i), counted over (symbols (F, P), movement) with Dirichlet smoothing (section IV.A).

    NOT_SEEN is not counted; a distribution without counts stays uniform.
    """
    parts = sequences[0][0].shape[1]
    counts = np.full((movements, bins, parts, VECTOR_SYMBOLS), float(smoothing))
    for symbols, movement in sequences:
        frame, part = np.nonzero(symbols >= 0)
        np.add.at(counts[movement], (bin_indices(len(symbols), bins)[frame], part, symbols[frame, part]), 1.0)
    log_table: Floats = np.log(counts / counts.sum(axis=-1, keepdims=True))
    return log_table


def log_evidence(log_table: Floats, symbols: Symbols) -> Floats:
    """(..., P, 9) log table and (P,) symbols -> (...) sum over parts of log P(b_bp | ...) (2).

    A part NOT_SEEN contributes the factor 1: "uniformly distributed descriptors" (section I).
    """
    parts = np.flatnonzero(symbols >= 0)
    evidence: Floats = log_table[..., parts, symbols[parts]].sum(axis=-1)
    return evidence


class FrameClock:
    """P(M_n+1 | i_1:n+1 b_1:n+1) proportional to P(M_n) P(b_n+1 | M i_n+1), from a uniform P(M) (section IV.B, (6)).

    bins: I_max. frames: the number of frames in which the clock passes through all bins; it then stays in the last.
    """

    def __init__(self, movements: int, bins: int, frames: int) -> None:
        self._log_p = np.zeros(movements)
        self._bins, self._frames = bins, max(frames, 1)
        self._n = 0

    @property
    def i(self) -> int:
        """The bin of the coming frame, 0 to I_max - 1."""
        return min(self._n * self._bins // self._frames, self._bins - 1)

    def condition(self, log_likelihood: Floats) -> None:
        """Bayes' rule (3) for one frame: (M,) log P(b | M i), for the current bin i."""
        self._log_p = self._log_p + log_likelihood
        self._log_p -= self._log_p.max()
        self._n += 1

    @property
    def p(self) -> Floats:
        """(M,) the posterior."""
        return softmax(self._log_p)


class FrameTable:
    """log P(B_bp | M, I), counted, with the frame I given by a clock.

    If the length is not known, the clock takes the mean length of the training examples and then stands still, as the
    paper's would.
    """

    kind: ClassVar[str] = "frame-table"
    # Chosen by leave-one-subject-out on the training subjects 1, 3, 5, 7, 9 of MSR Action3D: docs/design/paper.md.
    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "bins": Parameter(8.0, 1, 1000, whole=True),
        "threshold": Parameter(0.16),
        "smoothing": Positive(0.1),
    }

    def __init__(self, header: Header, log_table: Floats, mean_frames: float) -> None:
        self.header = header
        self.log_table = log_table
        self.mean_frames = mean_frames

    @classmethod
    def learn(cls, header: Header, examples: Sequence[Example]) -> Self:
        """Count Vector Symbols per movement, bin and part."""
        header = with_defaults(header, cls.PARAMETERS)
        parameters = header.parameters
        sequences = list[tuple[Symbols, int]]()
        for example in examples:
            reader = SpaceReader(header.body_parts, parameters["threshold"])
            sequences.append((np.array([reader.update(tracks) for tracks in example.tracks]), example.movement))
        bins, movements = int(parameters["bins"]), header.vocabulary.size
        table = learn_table(sequences, movements, bins, parameters["smoothing"])
        return cls(header, table, float(np.mean([len(e.tracks) for e in examples])))

    @classmethod
    def from_arrays(cls, header: Header, arrays: Arrays) -> Self:
        """From log_table (M, I, P, 9) and mean_frames (); raises ValueError if they do not fit the header."""
        mean_frames = float(arrays["mean_frames"])
        shape = (header.vocabulary.size, int(header.parameters["bins"]), len(header.body_parts), VECTOR_SYMBOLS)
        log_table = array_in(arrays, "log_table", shape, np.float64)
        if not np.allclose(np.logaddexp.reduce(log_table, axis=-1), 0.0):
            raise ValueError("log_table holds logarithms of probabilities whose sum is not 1")
        if not 1 <= mean_frames < 1e9:
            raise ValueError(f"mean_frames is {mean_frames:g}, a mean number of frames is expected")
        return cls(header, log_table, mean_frames)

    def arrays(self) -> Arrays:
        """log_table (M, I, P, 9) and mean_frames ()."""
        return {"log_table": self.log_table, "mean_frames": np.array(self.mean_frames)}

    def watch(self, onset: Onset) -> "_FrameTableWatch":
        """Start the frame clock."""
        threshold = self.header.parameters["threshold"]
        frames = onset.length if onset.known and onset.length else round(self.mean_frames)
        clock = FrameClock(self.header.vocabulary.size, self.log_table.shape[1], frames)
        return _FrameTableWatch(self.log_table, SpaceReader(self.header.body_parts, threshold), clock)


class _FrameTableWatch(Watch):
    def __init__(self, log_table: Floats, reader: SpaceReader, clock: FrameClock) -> None:
        self._log_table, self._reader, self._clock = log_table, reader, clock

    @property
    def p(self) -> Floats:
        return self._clock.p

    @property
    def rest(self) -> float:
        """The paper's model has no rest."""
        return 0.0

    def update(self, tracks: Tracks) -> None:
        symbols = self._reader.update(tracks)
        self._clock.condition(log_evidence(self._log_table[:, self._clock.i], symbols))
