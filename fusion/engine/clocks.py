"""The observers' clocks: when the newest frame of a posterior was captured, by our own clock. Pure: time is passed in.

The design: fusion.md, "The roster", 7. A capture time after the sending time contradicts itself: the frame counts as
captured when the message was sent.
"""

from dataclasses import dataclass, field

from common.clock_skew import ClockReading, ClockSkew
from common.messages import PosteriorMessage

IGNORED_SKEW_NS = 5_000_000
"""5 ms: a smaller skew is not corrected. It is less than a frame, and measurements over a network are no more exact."""


@dataclass(slots=True)
class _ObserverClock:
    """What is known of one observer's clock.

    correction_ns: what is subtracted from its stamps. session, seq, sent_ns: of the last message that was used.
    doubtful: the clock stood still or was set back since it was read; its messages count as sent on arrival.
    """

    skew: ClockSkew = field(default_factory=ClockSkew)
    skew_s: float | None = None
    correction_ns: int = 0
    session: str = ""
    seq: int = -1
    sent_ns: int = 0
    doubtful: bool = False

    def precedes(self, message: PosteriorMessage) -> bool:
        """Whether `message` is a later one of the same session; only those show how the clock runs."""
        return message.session == self.session and message.seq > self.seq


class Clocks:
    """The clocks of the observers of one scene. Observers of other names are ignored."""

    def __init__(self, observers: list[str]) -> None:
        self._clocks = {observer: _ObserverClock() for observer in observers}

    def record_reading(self, observer: str, reading: ClockReading) -> None:
        """Take a reading of an observer's clock, which ends a doubt about it."""
        if observer in self._clocks:
            clock = self._clocks[observer]
            clock.skew.note(reading)
            clock.skew_s = clock.skew.skew_s
            clock.correction_ns, clock.doubtful = _correction_ns(clock.skew.best), False

    def skew_s(self, observer: str) -> float | None:
        """Seconds by which an observer's clock is ahead of ours; None before the first reading."""
        return self._clocks[observer].skew_s if observer in self._clocks else None

    def captured_ns(self, observer: str, message: PosteriorMessage, now_ns: int) -> int:
        """The capture time, by our clock, of the newest frame in `message`, which arrived at `now_ns`.

        Not later than `now_ns`; as stamped if the observer is not one of the scene.
        """
        clock = self._clocks.get(observer)
        if clock is None:
            return message.captured_ns
        captured_ns, sent_ns = message.captured_ns, message.sent_ns
        if captured_ns > sent_ns:
            captured_ns = sent_ns
        latest_ns = now_ns - (sent_ns - captured_ns)
        if clock.doubtful or (sent_ns <= clock.sent_ns and clock.precedes(message)):
            return latest_ns
        captured_ns -= clock.correction_ns
        return captured_ns if captured_ns < latest_ns else latest_ns

    def record_message(self, observer: str, message: PosteriorMessage) -> None:
        """Remember the stamps of a message that was used, to compare the next one's with."""
        clock = self._clocks[observer]
        if message.sent_ns <= clock.sent_ns and clock.precedes(message):
            clock.doubtful = True
        clock.session, clock.seq, clock.sent_ns = message.session, message.seq, message.sent_ns


def _correction_ns(reading: ClockReading | None) -> int:
    """The skew, or 0 if it is no larger than the uncertainty of the measurement."""
    if reading is None or abs(reading.skew_ns) <= max(reading.doubt_ns, IGNORED_SKEW_NS):
        return 0
    return reading.skew_ns
