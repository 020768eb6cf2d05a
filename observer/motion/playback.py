"""Plays recorded motion: in real time, faster, or as fast as possible."""

import itertools
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from common import SECOND_NS
from observer.motion.archive import Recording
from observer.tracks import Frame

Clock = Callable[[], int]
Start = int | Callable[[threading.Event], int] | None
"""When playback begins: Unix epoch, ns; or a function that waits until the others are ready and returns that, and ends
soon when the event is set; or None for now."""
REPEAT_S = 0.09
"""In slow motion a frame is repeated so often: its posterior stays as new as that of a camera of 10 Hz."""
LATE_S = 0.1
"""A picture that is so late is skipped if the next one is due too."""
LONGEST_WAIT_S = 3600.0
"""At once; the operating system does not take just any number."""


@dataclass(frozen=True, slots=True)
class RecordedMotion:
    """A FrameSource that plays recordings one after the other, completely and never ahead of time.

    Frame i is captured at start + i / rate / speed; start is `start_ns`, or now. speed 0: no waiting, and the capture
    time is the time of playback. If the observer is slower than the motion, frames come late and none is dropped.
    repeats: in slow motion, frames are repeated, as in `repeated_until`.
    """

    archive_parts: tuple[str, ...]
    recordings: Sequence[Recording]
    speed: float = 1.0
    loop: bool = False
    start_ns: Start = None
    clock: Clock = time.time_ns
    repeats: bool = False

    @property
    def length(self) -> int:
        """Frames of the first recording."""
        return len(self.recordings[0].positions)

    @property
    def rate_hz(self) -> float:
        """Frames per second of motion, of the first recording."""
        return self.recordings[0].rate_hz

    @property
    def body_parts(self) -> tuple[str, ...]:
        """The archive's body parts, rows of `Frame.content`."""
        return self.archive_parts

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """Each frame when it is due; ends soon after `stop` is set."""
        due_ns = begin_ns(self.start_ns, stop, self.clock)
        motion_ns = 0
        frame: Frame | None = None
        for recording in itertools.cycle(self.recordings) if self.loop else self.recordings:
            for i, positions in enumerate(recording.positions):
                this_ns = due_ns + self._offset_ns(i, recording)
                if self.repeats:
                    yield from repeated_until(frame, this_ns, self.speed, stop, self.clock)
                captured_ns = wait_until(this_ns, self.speed, stop, self.clock)
                if captured_ns is None:
                    return
                at_ns = motion_ns + round(i * SECOND_NS / recording.rate_hz)
                frame = Frame(captured_ns, positions.astype(float), at_ns, last=i + 1 == len(recording.positions))
                yield frame
            due_ns += self._offset_ns(len(recording.positions), recording)
            motion_ns += round(len(recording.positions) * SECOND_NS / recording.rate_hz)

    def _offset_ns(self, frame: int, recording: Recording) -> int:
        return round(frame * SECOND_NS / recording.rate_hz / self.speed) if self.speed else 0


def begin_ns(start: Start, stop: threading.Event, clock: Clock) -> int:
    """When playback begins; waits if there is something to wait for."""
    if start is None:
        return clock()
    return start(stop) if callable(start) else start


def is_overtaken(due_ns: int, next_ns: int, speed: float, now_ns: int) -> bool:
    """Whether a picture comes so late that the next one, due at `next_ns`, is due as well. None is without waiting."""
    return speed > 0 and now_ns >= next_ns and now_ns - due_ns > LATE_S * SECOND_NS


def repeated_until(
    frame: Frame | None, due_ns: int, speed: float, stop: threading.Event, clock: Clock
) -> Iterator[Frame]:
    """In slow motion, `frame` again and again until the next one is due, unless its recording has ended with it."""
    if frame is None or frame.last or not 0 < speed < 1:
        return
    step_ns = round(REPEAT_S * SECOND_NS)
    at_ns = frame.captured_ns + step_ns
    while at_ns + step_ns // 2 < due_ns and wait_until(at_ns, speed, stop, clock) is not None:
        yield replace(frame, captured_ns=at_ns, repeated=True)
        at_ns = max(at_ns + step_ns, clock())


def wait_until(due_ns: int, speed: float, stop: threading.Event, clock: Clock) -> int | None:
    """Wait, then return the capture time: `due_ns`, or now if speed is 0; None if stopped before."""
    while not stop.is_set():
        now_ns = clock()
        if now_ns >= due_ns:
            return due_ns if speed else now_ns
        stop.wait(min((due_ns - now_ns) / SECOND_NS, LONGEST_WAIT_S))
    return None
