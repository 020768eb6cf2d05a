"""The observers' clocks: when a posterior's frame was captured by our own clock. Pure: time is passed in.

1. What an observer dates is moved by its measured skew, unless that is within what the measurement can tell.
2. Nothing was sent after it arrived: what is still dated later than now was sent at the earliest when it came, so it
   is as old as the observer's own two stamps are apart. So an hour fast does not look fresh for ever.
3. Two messages were not sent at the same time: where the second is dated no later, that clock stands still or was
   set back, and rule 2's way is taken until it was asked again.
4. What an observer dates later than its own sending contradicts itself: it is taken as captured when it was sent.
"""

from dataclasses import dataclass, field

from common.clock_skew import ClockReading, ClockSkew
from common.messages import PosteriorMessage

UNNOTICED_NS = 5_000_000
"""A skew this small is not corrected: it is less than a frame, and measuring it is no more exact over a network."""


@dataclass(slots=True)
class _Clock:
    skew: ClockSkew = field(default_factory=ClockSkew)
    session: str = ""
    seq: int = -1
    sent_ns: int = 0
    doubtful: bool = False


class Clocks:
    """The clocks of the observers of one scene; of others nothing is kept."""

    def __init__(self, observers: list[str]) -> None:
        self._clocks = {observer: _Clock() for observer in observers}

    def read(self, observer: str, reading: ClockReading) -> None:
        """An observer was asked for the time."""
        if observer in self._clocks:
            self._clocks[observer].skew.note(reading)
            self._clocks[observer].doubtful = False

    def skew_s(self, observer: str) -> float | None:
        """Seconds by which an observer's clock is ahead of ours; None while it was never asked."""
        return self._clocks[observer].skew.skew_s if observer in self._clocks else None

    def captured_ns(self, observer: str, message: PosteriorMessage, now_ns: int) -> int:
        """When the newest frame in `message`, which came at `now_ns`, was captured by our clock."""
        if observer not in self._clocks:
            return message.captured_ns
        clock = self._clocks[observer]
        at_once_ns = now_ns - max(0, message.sent_ns - message.captured_ns)
        if _doubtful(clock, message):
            return at_once_ns
        captured_ns = min(message.captured_ns, message.sent_ns) - _correction_ns(clock.skew.best)
        return min(captured_ns, at_once_ns)

    def heard(self, observer: str, message: PosteriorMessage) -> None:
        """A message was used: the next one's stamps are compared with its own."""
        clock = self._clocks[observer]
        clock.doubtful = _doubtful(clock, message)
        clock.session, clock.seq, clock.sent_ns = message.session, message.seq, message.sent_ns


def _doubtful(clock: _Clock, message: PosteriorMessage) -> bool:
    """Rule 3; copies and stragglers say nothing of the clock, and a new session no more than that it was doubted."""
    follows = message.session == clock.session and message.seq > clock.seq
    return clock.doubtful or (follows and message.sent_ns <= clock.sent_ns)


def _correction_ns(reading: ClockReading | None) -> int:
    if reading is None or abs(reading.skew_ns) <= max(reading.doubt_ns, UNNOTICED_NS):
        return 0
    return reading.skew_ns
