"""Plays recorded motion: in real time, faster, or as fast as possible."""

import itertools
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from common import SECOND_NS
from observer.motion.archive import Recording
from observer.tracks import Frame

Clock = Callable[[], int]


@dataclass(frozen=True, slots=True)
class RecordedMotion:
    """A FrameSource that plays recordings one after the other, completely and never ahead of time.

    Frame i is captured at start + i / rate / speed; start is `start_ns`, or now. speed 0: no waiting, and the capture
    time is the time of playback. If the observer is slower than the motion, frames come late and none is dropped.
    """

    archive_parts: tuple[str, ...]
    recordings: Sequence[Recording]
    speed: float = 1.0
    loop: bool = False
    start_ns: int | None = None
    clock: Clock = time.time_ns

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
        due_ns = self.clock() if self.start_ns is None else self.start_ns
        motion_ns = 0
        for recording in itertools.cycle(self.recordings) if self.loop else self.recordings:
            for i, positions in enumerate(recording.positions):
                captured_ns = wait_until(due_ns + self._offset_ns(i, recording), self.speed, stop, self.clock)
                if captured_ns is None:
                    return
                at_ns = motion_ns + round(i * SECOND_NS / recording.rate_hz)
                yield Frame(captured_ns, positions.astype(float), at_ns, last=i + 1 == len(recording.positions))
            due_ns += self._offset_ns(len(recording.positions), recording)
            motion_ns += round(len(recording.positions) * SECOND_NS / recording.rate_hz)

    def _offset_ns(self, frame: int, recording: Recording) -> int:
        return round(frame * SECOND_NS / recording.rate_hz / self.speed) if self.speed else 0


def wait_until(due_ns: int, speed: float, stop: threading.Event, clock: Clock) -> int | None:
    """Wait, then return the capture time: `due_ns`, or now if speed is 0; None if stopped before."""
    while not stop.is_set():
        now_ns = clock()
        if now_ns >= due_ns:
            return due_ns if speed else now_ns
        stop.wait((due_ns - now_ns) / SECOND_NS)
    return None
