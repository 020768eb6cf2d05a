"""Plays recorded motion: in real time, faster, or as fast as possible; recordings of a scene begin together.

`labanmesh up` makes a folder with a file ID.awaited for each observer that plays a recording, and takes that away when
the process has failed. An observer that is ready writes ID.ready with the time, and waits for the others. The first to
see them all writes the begin to `begin`, once and for all.
"""

import itertools
import logging
import os
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from common import SECOND_NS
from common.text import plural
from observer.motion.archive import Recording
from observer.tracks import Clock, Frame

Start = int | Callable[[threading.Event], int] | None
"""When playback begins: Unix epoch, ns; or a function that waits until the others are ready and returns that, and ends
soon when the event is set; or None for now."""
FRAME_REPEAT_S = 0.09
"""In slow motion a frame is repeated so often: its posterior stays as new as that of a camera of 10 Hz."""
FRAME_LATE_S = 0.1
"""After a short stall an observer catches up without a loss; frames later than this are skipped if newer ones are
due."""
NEVER_NS = 10**9 * SECOND_NS
"""Nothing follows the last recording."""
LONGEST_WAIT_S = 3600.0
"""At once; the operating system does not take just any number."""


class FrameSkipper:
    """Decides which frames a source leaves out for an observer that is too slow, so that it stays current.

    1. Late frames are delivered while the delay is at most FRAME_LATE_S: the observer catches up by itself.
    2. After a longer delay each frame that a newer one has overtaken is skipped: the observer gets the newest.
    3. That ends when the observer has to wait for a frame.
    """

    def __init__(self) -> None:
        self._behind = False
        self._skipped = 0

    def skips(self, due_ns: int, asked_ns: int, overtaken: bool) -> bool:
        """Whether to leave out the frame that was due at `due_ns`. asked_ns: when the observer asked for a frame.

        overtaken: a newer frame can be delivered instead.
        """
        if due_ns > asked_ns:
            self._behind = False
        elif asked_ns - due_ns > FRAME_LATE_S * SECOND_NS:
            self._behind = True
        skipped = self._behind and overtaken
        self._skipped += skipped
        return skipped

    def count(self) -> int:
        """How many frames were skipped since the last call."""
        skipped, self._skipped = self._skipped, 0
        return skipped


@dataclass(slots=True)
class FramePlayer:
    """Delivers the frames of a recording: each when it is due, and for an observer that is too slow the newest.

    speed 0: no waiting and no skipping; the capture time is the time of playback. Below 1, in slow motion, frames are
    repeated, so that their posterior stays new.
    """

    speed: float
    stop: threading.Event
    clock: Clock
    _skipper: FrameSkipper = field(default_factory=FrameSkipper)
    _last: Frame | None = None

    def skips(self, due_ns: int, next_ns: int) -> bool:
        """Whether to leave out the frame that was due at `due_ns`, as the next one, due at `next_ns`, is due too."""
        if not self.speed:
            return False
        now_ns = self.clock()
        return self._skipper.skips(due_ns, now_ns, now_ns >= next_ns)

    def wait(self, due_ns: int) -> Generator[Frame, None, int | None]:
        """Wait for a frame, with repetitions of the one before; returns its capture time, None if stopped before."""
        yield from self._repeated_until(due_ns)
        return self._wait_until(due_ns)

    def delivers(self, frame: Frame) -> Frame:
        """The frame, with the number of those that were skipped before it."""
        self._last = replace(frame, skipped=self._skipper.count())
        return self._last

    def _repeated_until(self, due_ns: int) -> Iterator[Frame]:
        """The last frame again and again until the next one is due, unless its recording has ended with it."""
        frame = self._last
        if frame is None or frame.last or not 0 < self.speed < 1:
            return
        step_ns = round(FRAME_REPEAT_S * SECOND_NS)
        at_ns = frame.captured_ns + step_ns
        while at_ns + step_ns // 2 < due_ns and self._wait_until(at_ns) is not None:
            yield replace(frame, captured_ns=at_ns, repeated=True, skipped=0)
            at_ns = max(at_ns + step_ns, self.clock())

    def _wait_until(self, due_ns: int) -> int | None:
        """Wait, then return the capture time: `due_ns`, or now if speed is 0; None if stopped before."""
        while not self.stop.is_set():
            now_ns = self.clock()
            if now_ns >= due_ns:
                return due_ns if self.speed else now_ns
            self.stop.wait(min((due_ns - now_ns) / SECOND_NS, LONGEST_WAIT_S))
        return None


Show = Callable[[Recording, int, int], NDArray[Any]]
"""Returns the content of frame i of a recording. The last argument numbers the frames of all that is played."""


@dataclass(frozen=True, slots=True)
class RecordedMotion:
    """A FrameSource that plays recordings one after the other, as `FramePlayer` does, never ahead of time.

    body_parts: rows of `Frame.content`. Frame i is captured at start + i / rate / speed; start is `start_ns`, or now.
    The last frame of a recording, with which a movement ends, is skipped only when the recording after it is over too.
    """

    body_parts: tuple[str, ...]
    recordings: Sequence[Recording]
    speed: float = 1.0
    loop: bool = False
    start_ns: Start = None
    clock: Clock = time.time_ns

    @property
    def length(self) -> int:
        """Frames of the first recording."""
        return len(self.recordings[0].positions)

    @property
    def rate_hz(self) -> float:
        """Frames per second of motion, of the first recording."""
        return self.recordings[0].rate_hz

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """Each frame when it is due; ends soon after `stop` is set."""
        return self.shown(stop, lambda recording, i, _: recording.positions[i].astype(float))

    def shown(self, stop: threading.Event, show: Show) -> Iterator[Frame]:
        """The same frames with other contents, which `show` makes of those that are delivered."""
        begun_ns = begin_ns(self.start_ns, stop, self.clock)
        player = FramePlayer(self.speed, stop, self.clock)
        motion_ns = number = 0
        for recording, following in self._in_order():
            count = len(recording.positions)
            for i in range(count):
                last = i + 1 == count
                at_ns = motion_ns + _at_ns(recording, i)
                newer_ns = motion_ns + _at_ns(recording, i + 1)
                if last:
                    newer_ns += _at_ns(following, len(following.positions)) if following else NEVER_NS
                due_ns = begun_ns + self._played_ns(at_ns)
                if not player.skips(due_ns, begun_ns + self._played_ns(newer_ns)):
                    captured_ns = yield from player.wait(due_ns)
                    if captured_ns is None:
                        return
                    yield player.delivers(Frame(captured_ns, show(recording, i, number), at_ns, last))
                number += 1
            motion_ns += _at_ns(recording, count)

    def _in_order(self) -> Iterator[tuple[Recording, Recording | None]]:
        """Each recording with the one that follows it."""
        if self.loop:
            return itertools.pairwise(itertools.cycle(self.recordings))
        return zip(self.recordings, [*self.recordings[1:], None], strict=True)

    def _played_ns(self, motion_ns: int) -> int:
        return round(motion_ns / self.speed) if self.speed else 0


def _at_ns(recording: Recording, i: int) -> int:
    """When frame i begins, from the recording's begin."""
    return round(i * SECOND_NS / recording.rate_hz)


def begin_ns(start: Start, stop: threading.Event, clock: Clock) -> int:
    """When playback begins; waits if there is something to wait for."""
    if start is None:
        return clock()
    return start(stop) if callable(start) else start


log = logging.getLogger("labanmesh.observer")

BARRIER = "LABANMESH_PLAYBACK_MEETING"
"""Environment variable: the folder."""
AHEAD_S = 0.3
"""From the moment at which the last one is ready to the begin: all others have noticed it by then."""
BARRIER_TIMEOUT_S = 60.0
"""Longest time for which an observer that is ready waits for the others."""
BARRIER_CHECK_S = 0.03
BEGIN = "begin"


@dataclass(frozen=True, slots=True)
class StartBarrier:
    """Called by the source of `observer` when it is ready: waits, and returns the begin (Unix epoch, ns).

    earliest_ns: the recordings do not begin before.
    """

    folder: Path
    observer: str
    earliest_ns: int = 0
    clock: Callable[[], int] = time.time_ns
    timeout_s: float = BARRIER_TIMEOUT_S

    def __call__(self, stop: threading.Event) -> int:
        """The begin; as soon as possible if the folder is gone or `stop` is set."""
        try:
            begin_ns = self._begin()
            return self._wait(stop) if begin_ns is None else begin_ns
        except (OSError, ValueError) as error:
            log.warning("cannot wait for the other recordings: %s", error)
            return max(self.earliest_ns, self.clock())

    def _wait(self, stop: threading.Event) -> int:
        ready_ns = self.clock()
        self._write(f"{self.observer}.ready", ready_ns)
        while not stop.is_set():
            missing = self._missing()
            late = self.clock() - ready_ns > self.timeout_s * SECOND_NS
            if missing and late:
                others = f"{plural(len(missing), 'observer')}: {', '.join(missing)}"
                log.warning("begins without %s: not ready after %g s", others, self.timeout_s)
            if not missing or late:
                self._agree()
            if (begin_ns := self._begin()) is not None:
                return begin_ns
            stop.wait(BARRIER_CHECK_S)
        return self.clock()

    def _missing(self) -> list[str]:
        return sorted(p.stem for p in self.folder.glob("*.awaited") if not p.with_suffix(".ready").exists())

    def _agree(self) -> None:
        begin_ns = max(self.clock() + round(AHEAD_S * SECOND_NS), self.earliest_ns)
        own = self._write(f"{self.observer}.proposal", begin_ns)
        try:
            os.link(own, self.folder / BEGIN)  # fails if another one was first
        except FileExistsError:
            return

    def _begin(self) -> int | None:
        path = self.folder / BEGIN
        return int(path.read_text()) if path.exists() else None

    def _write(self, name: str, value: int) -> Path:
        """A file that is never seen half written."""
        path, part = self.folder / name, self.folder / f"{name}.part"
        part.write_text(str(value))
        part.replace(path)
        return path
