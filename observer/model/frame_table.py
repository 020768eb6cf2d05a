"""`frame-table`: the paper's own model, (2) to (6) to the letter. It must be told where a movement begins and ends."""

from collections.abc import Sequence
from typing import ClassVar, Self

import numpy as np

from observer.belief.frame_clock import FrameClock
from observer.model.base import Arrays, Example, Header, Onset, with_defaults
from observer.model.symbol_table import learn_table, log_evidence, symbols_of
from observer.space import SpaceReader
from observer.tracks import Floats, Tracks

# Chosen by leave-one-subject-out on the training subjects 1, 3, 5, 7, 9 of MSR Action3D: docs/paper.md.
DEFAULTS = {"bins": 8.0, "threshold": 0.16, "smoothing": 0.1}


class FrameTable:
    """log P(B_bp | M, I), with the frame I given by a clock.

    Without a known length the clock runs as long as the training examples did on average and then stands still: the
    model is then as lost as the paper's would be.
    """

    kind: ClassVar[str] = "frame-table"

    def __init__(self, header: Header, log_table: Floats, mean_frames: float) -> None:
        self.header = header
        self._log_table = log_table
        self._mean_frames = mean_frames

    @classmethod
    def learn(cls, header: Header, examples: Sequence[Example]) -> Self:
        """Count Vector Symbols per movement, bin and part; `header.parameters`: bins, threshold, smoothing."""
        header = with_defaults(header, DEFAULTS)
        given = header.parameters
        sequences = [(symbols_of(e, header.body_parts, given["threshold"]), e.movement) for e in examples]
        table = learn_table(sequences, header.vocabulary.size, int(given["bins"]), given["smoothing"])
        return cls(header, table, float(np.mean([len(e.tracks) for e in examples])))

    @classmethod
    def from_arrays(cls, header: Header, arrays: Arrays) -> Self:
        """From log_table (M, I, P, 9) and mean_frames ()."""
        return cls(header, np.asarray(arrays["log_table"], dtype=np.float64), float(arrays["mean_frames"]))

    def arrays(self) -> Arrays:
        """log_table (M, I, P, 9) and mean_frames ()."""
        return {"log_table": self._log_table, "mean_frames": np.array(self._mean_frames)}

    def watch(self, onset: Onset) -> "_FrameTableWatch":
        """Start the frame clock."""
        threshold = self.header.parameters["threshold"]
        frames = onset.length if onset.known and onset.length else round(self._mean_frames)
        clock = FrameClock(self.header.vocabulary.size, self._log_table.shape[1], frames)
        return _FrameTableWatch(self._log_table, SpaceReader(self.header.body_parts, threshold), clock)


class _FrameTableWatch:
    """The paper knows no rest: `rest` is always 0."""

    rest = 0.0

    def __init__(self, log_table: Floats, reader: SpaceReader, clock: FrameClock) -> None:
        self._log_table, self._reader, self._clock = log_table, reader, clock

    @property
    def p(self) -> Floats:
        return self._clock.p

    def update(self, tracks: Tracks) -> None:
        symbols = self._reader.update(tracks)
        self._clock.condition(log_evidence(self._log_table[:, self._clock.i], symbols))
