"""`frame-table`: the paper's own model, (2) to (6) to the letter. It must be told where a movement begins and ends."""

from collections.abc import Mapping
from typing import ClassVar

from observer.belief.frame_clock import FrameClock
from observer.model.base import Onset
from observer.model.symbol_table import SymbolTable, log_evidence
from observer.space import SpaceReader
from observer.tracks import Floats, Tracks


class FrameTable(SymbolTable):
    """log P(B_bp | M, I), with the frame I given by a clock.

    Without a known length the clock runs as long as the training examples did on average and then stands still: the
    model is then as lost as the paper's would be.
    """

    kind: ClassVar[str] = "frame-table"
    # Chosen by leave-one-subject-out on the training subjects 1, 3, 5, 7, 9 of MSR Action3D: docs/design/paper.md.
    DEFAULTS: ClassVar[Mapping[str, float]] = {"bins": 8.0, "threshold": 0.16, "smoothing": 0.1, "neighbours": 0.0}
    BINS = "bins"

    def watch(self, onset: Onset) -> "_FrameTableWatch":
        """Start the frame clock."""
        threshold = self.header.parameters["threshold"]
        frames = onset.length if onset.known and onset.length else round(self.mean_frames)
        clock = FrameClock(self.header.vocabulary.size, self.log_table.shape[1], frames)
        return _FrameTableWatch(self.log_table, SpaceReader(self.header.body_parts, threshold), clock)


class _FrameTableWatch:
    """The paper knows no rest: `rest` is always 0."""

    rest = 0.0
    joint = None
    foreseen = None
    unlearned = None

    def __init__(self, log_table: Floats, reader: SpaceReader, clock: FrameClock) -> None:
        self._log_table, self._reader, self._clock = log_table, reader, clock

    @property
    def p(self) -> Floats:
        return self._clock.p

    def update(self, tracks: Tracks) -> None:
        symbols = self._reader.update(tracks)
        self._clock.condition(log_evidence(self._log_table[:, self._clock.i], symbols))
