"""The segment of a stream since the begin of a movement, which stillness before the movement shows. Pure."""

from observer.model.body_trace import Floats32

STILL_LAG_S = 0.3
"""Stillness is noticed so late; a movement begins that long before."""


class MovementSegment:
    """Begins when rest ends, and is over while the person rests after it.

    begun: frames since its begin, None while that is unknown; over: whether the person rests after it. lag: frames by
    which stillness is noticed late. onset_known: the first frame is a begin. longest: frames of the longest segment.
    """

    def __init__(self, rate_hz: float, onset_known: bool, longest: float) -> None:
        self.begun: int | None = 0 if onset_known else None
        self.over = False
        self.lag = max(round(STILL_LAG_S * rate_hz), 1)
        self._longest = longest
        self._moved = self._moved_before = not onset_known
        self._rested = 0

    def update(self, resting: bool, stored: int) -> None:
        """Take in whether the person rests in one more frame; stored: the number of frames whose rows are stored."""
        self._moved = self._moved or not resting
        if self.begun is not None:
            self.over = resting and self._moved
            self.begun += not self.over
            if self.begun > min(self._longest, stored):
                self.begun = None
        if self._rested >= self.lag and not resting and self._moved_before:
            self.begun, self.over = min(self.lag, stored), False
        if resting and self._moved:
            self._moved_before = True
        self._rested = self._rested + 1 if resting else 0

    def rows_of(self, rows: Floats32) -> Floats32:
        """(F, C) rows of the stream until now -> those of the segment; none where no begin is known."""
        begun, rested = self.begun or 0, self._rested if self.over else 0
        return rows[-begun - rested :][:begun]
