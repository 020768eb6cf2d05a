"""Frame sources of a foreign tracker: JSON lines on the standard input, or one line a message on a Zenoh key."""

import logging
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import BinaryIO

from common import SECOND_NS
from common.errors import BadInput
from common.inbox import Inbox
from common.link import Link
from common.text import plural
from observer.camera.base import NOMINAL_HZ, Clock, Report, ignore_report
from observer.foreign.track_line import MAX_BYTES, frame_of_line
from observer.motion.playback import FrameSkipper
from observer.tracks import BODY_PARTS, Frame

log = logging.getLogger("labanmesh.observer")
TRACKER_SILENCE_S = 0.9
"""A tracker without lines for this long is lost: it is reported as degraded within a second, as a camera is."""
LINE_WAIT_S = 0.1
WARN_AGAIN_S = 60.0
"""The first rejected line is logged at once, later ones once a minute with their count."""

QUEUE_LINES = 256
"""Lines that wait for the observer; a writer that is faster has to wait."""
RECORDED_S = 60.0
"""Lines captured longer ago are a recording, of which none is skipped: no live tracker is so late."""

Line = tuple[bytes, int]
"""A line, and when it arrived (Unix epoch, ns)."""
Take = Callable[[float], list[Line] | None]
"""Returns lines, waiting for at most that many seconds; None at the end of the input."""


@dataclass(slots=True)
class LineTracks:
    """Turns lines into frames, for both sources below. A bad line is counted in `rejected`, logged and dropped.

    way_out: what to do when no lines come.

    Of the lines that wait for an observer that is too slow, the newest is delivered (`FrameSkipper`).
    """

    name: str
    report: Report = ignore_report
    clock: Clock = time.time_ns
    rate_hz: float = NOMINAL_HZ
    body_parts: tuple[str, ...] = BODY_PARTS
    way_out: str = "is the other tracker running?"
    rejected: int = 0
    _skipper: FrameSkipper = field(default_factory=FrameSkipper)
    _warned_ns: int | None = None
    _fault: str = ""

    def frames_of(self, take: Take, stop: threading.Event) -> Iterator[Frame]:
        """The frames of valid lines, until the input ends or `stop` is set."""
        newest_ns, waiting = self.clock(), deque[tuple[Frame, int]]()
        while not stop.is_set():
            asked_ns = self.clock()
            lines = [] if len(waiting) >= QUEUE_LINES else take(0.0 if waiting else LINE_WAIT_S)
            if lines is None and not waiting:
                return
            for line, arrived_ns in lines or ():
                newest_ns = arrived_ns
                if (frame := self._parse(line, arrived_ns)) is not None:
                    waiting.append((frame, arrived_ns))
            if waiting:
                self._set_fault("")
                frame, arrived_ns = waiting.popleft()
                recorded = asked_ns - frame.captured_ns > RECORDED_S * SECOND_NS
                if recorded or not self._skipper.skips(arrived_ns, asked_ns, bool(waiting)):
                    yield replace(frame, skipped=self._skipper.count())
            elif self.clock() - newest_ns > TRACKER_SILENCE_S * SECOND_NS:
                self._set_fault(f"{self.name}: no tracks for {TRACKER_SILENCE_S:g} s; {self.way_out}")

    def _parse(self, line: bytes, arrived_ns: int) -> Frame | None:
        if not line.strip():
            return None
        try:
            return frame_of_line(line, self.body_parts, arrived_ns)
        except BadInput as error:
            self.rejected += 1
            if self._warned_ns is None or arrived_ns - self._warned_ns > WARN_AGAIN_S * SECOND_NS:
                self._warned_ns = arrived_ns
                log.warning("%s: rejected %s so far, the last: %s", self.name, plural(self.rejected, "line"), error)
            return None

    def _set_fault(self, fault: str) -> None:
        if fault != self._fault:
            self._fault = fault
            log.warning("%s", fault) if fault else log.info("%s: tracks again", self.name)
            self.report("degraded" if fault else "running", fault)


class _LineSource:
    """The properties that both sources share."""

    __slots__ = ()
    lines: LineTracks

    @property
    def rate_hz(self) -> float:
        """Nominal: each line carries its own time."""
        return self.lines.rate_hz

    @property
    def body_parts(self) -> tuple[str, ...]:
        """The rows of a frame's content."""
        return self.lines.body_parts


@dataclass(slots=True)
class PipedTracks(_LineSource):
    """Tracks as JSON lines on a stream, e.g. the standard input; ends when the stream does.

    A thread reads the stream, because a blocking read cannot be stopped.
    """

    stream: BinaryIO
    lines: LineTracks
    _queue: "queue.Queue[Line | None]" = field(default_factory=lambda: queue.Queue(QUEUE_LINES))
    _ended: bool = False

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """One frame per line."""
        threading.Thread(target=self._read, name="tracks", daemon=True).start()
        return self.lines.frames_of(self._take, stop)

    def _read(self) -> None:
        while line := self.stream.readline(MAX_BYTES + 2):
            self._queue.put((line, self.lines.clock()))
        self._queue.put(None)

    def _take(self, timeout_s: float) -> list[Line] | None:
        lines: list[Line] = []
        with suppress(queue.Empty):
            while not self._ended and len(lines) < QUEUE_LINES:
                line = self._queue.get(timeout=0.0 if lines else timeout_s)
                if line is None:
                    self._ended = True
                else:
                    lines.append(line)
        return None if self._ended and not lines else lines


@dataclass(slots=True)
class MeshTracks(_LineSource):
    """Tracks on a Zenoh key, one JSON object a message; never ends by itself. Call `listen` before `frames`."""

    key: str
    lines: LineTracks
    _inbox: Inbox = field(default_factory=Inbox)

    def listen(self, link: Link) -> None:
        """Subscribe to the key on the observer's own link."""
        self._inbox = link.inbox(self.key)

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """One frame per message."""
        return self.lines.frames_of(self._take, stop)

    def _take(self, timeout_s: float) -> list[tuple[bytes, int]]:
        return [(a.payload, a.arrived_ns) for a in self._inbox.take(timeout_s)]
