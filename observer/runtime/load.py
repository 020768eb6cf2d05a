"""Tells whether an observer keeps up with its source. Pure.

A source in real time skips frames when the observer is too slow (`observer.motion.playback.FrameSkipper`). Frames on
which the tracker would have rested anyway (pacing.py) do not count: that is no fault.
"""

from collections import deque

from common import SECOND_NS
from common.message_types import OVERLOADED

SECONDS = 4
"""An observer is behind, or keeps up again, when so many seconds in a row show it: a single stall is no fault."""
BEHIND_SHARE, ENOUGH_SHARE = 0.7, 0.9
"""It is behind while it uses less than the first share of the frames, until it uses more than the second."""
RENEWED = 1.5
"""The complaint is renewed when the rate has changed by this factor, so that it does not change each second."""
WAY_OUT = "try smaller pictures (size_px), a lower rate_hz, a lighter tracker or another machine"


class LoadMeter:
    """Counts the frames of a source that its observer uses and those that it is too slow for.

    frames: the word for them, e.g. pictures. complaint: what an overloaded observer says of itself; "" if it keeps up.
    """

    def __init__(self, frames: str = "frames") -> None:
        self._frames = frames
        self._seconds: deque[tuple[float, float]] = deque(maxlen=SECONDS)
        self._begun_ns: int | None = None
        self._used = self._missed = 0
        self._stated_hz = 0.0
        self.complaint = ""

    def record(self, at_ns: int, missed: int) -> None:
        """The frame captured at `at_ns` is used; `missed`: those before it that would have been used, too."""
        if self._begun_ns is None or at_ns < self._begun_ns:
            self._begun_ns = at_ns
            return
        self._used, self._missed = self._used + 1, self._missed + missed
        elapsed_s = (at_ns - self._begun_ns) / SECOND_NS
        if elapsed_s >= 1:
            self._seconds.append((self._used / elapsed_s, (self._used + self._missed) / elapsed_s))
            self._begun_ns, self._used, self._missed = at_ns, 0, 0
            self._judge()

    def _judge(self) -> None:
        shares = [used_hz / offered_hz for used_hz, offered_hz in self._seconds]
        used_hz, offered_hz = (sum(rates) / len(shares) for rates in zip(*self._seconds, strict=True))
        if len(shares) < SECONDS:
            return
        if self.complaint and min(shares) >= ENOUGH_SHARE:
            self.complaint = ""
        elif (not self.complaint and max(shares) < BEHIND_SHARE) or (self.complaint and self._is_outdated()):
            self._stated_hz = used_hz
            numbers = f"uses {used_hz:.3g} of {offered_hz:.3g} {self._frames} a second"
            self.complaint = f"{numbers}: {OVERLOADED}; {WAY_OUT}"

    def _is_outdated(self) -> bool:
        factors = [used_hz / self._stated_hz for used_hz, _ in self._seconds]
        return min(factors) > RENEWED or max(factors) < 1 / RENEWED
