"""Frame sources of somebody else's tracks: JSON lines on the standard input, or one line a message on a Zenoh key."""

import logging
import queue
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import BinaryIO

from common.errors import BadInput
from common.inbox import Inbox
from common.link import Link
from observer.camera.base import NOMINAL_HZ, Clock, Report, unheard
from observer.foreign.track_line import LIMIT, frame_of_line
from observer.tracks import BODY_PARTS, Frame

log = logging.getLogger("labanmesh.observer")
SILENCE_S = 0.9
"""No line for so long: the other tracker is lost. It shows as degraded within a second, as a camera's silence does."""
TAKE_S = 0.1
SAY_AGAIN_S = 60.0
"""A bad line is told at once, the next ones once a minute with their number."""

Take = Callable[[float], list[tuple[bytes, int]] | None]
"""Lines with their times of arrival, waiting up to so many seconds for one; None: there will be no more."""


@dataclass(slots=True)
class LineTracks:
    """Frames out of lines; what the two sources have in common. A bad line is counted, told, and left out."""

    name: str
    report: Report = unheard
    clock: Clock = time.time_ns
    rate_hz: float = NOMINAL_HZ
    body_parts: tuple[str, ...] = BODY_PARTS
    bad: int = 0
    _told_ns: int | None = None
    _fault: str = ""

    def frames_of(self, take: Take, stop: threading.Event) -> Iterator[Frame]:
        """Each good line's frame, until there are no more lines or `stop` is set."""
        heard_ns = self.clock()
        while not stop.is_set():
            lines = take(TAKE_S)
            if lines is None:
                return
            for line, arrived_ns in lines:
                heard_ns = arrived_ns
                frame = self._read(line, arrived_ns)
                if frame is not None:
                    self._say("")
                    yield frame
            if self.clock() - heard_ns > SILENCE_S * 1e9:
                self._say(f"{self.name}: no tracks for {SILENCE_S:g} s; is the other tracker running?")

    def _read(self, line: bytes, arrived_ns: int) -> Frame | None:
        if not line.strip():
            return None
        try:
            return frame_of_line(line, self.body_parts, arrived_ns)
        except BadInput as error:
            self.bad += 1
            if self._told_ns is None or arrived_ns - self._told_ns > SAY_AGAIN_S * 1e9:
                self._told_ns = arrived_ns
                log.warning("%s: left out %d line(s) so far, the last: %s", self.name, self.bad, error)
            return None

    def _say(self, fault: str) -> None:
        if fault != self._fault:
            self._fault = fault
            log.warning("%s", fault) if fault else log.info("%s: tracks again", self.name)
            self.report("degraded" if fault else "running", fault)


@dataclass(slots=True)
class PipedTracks:
    """Tracks as JSON lines on a stream, e.g. the standard input; ends when the stream does.

    A thread of its own reads, because a read cannot be told to stop; who writes faster than we work has to wait.
    """

    stream: BinaryIO
    lines: LineTracks
    _waiting: "queue.Queue[tuple[bytes, int] | None]" = field(default_factory=lambda: queue.Queue(256))

    @property
    def rate_hz(self) -> float:
        """Nominal: each line says when it was."""
        return self.lines.rate_hz

    @property
    def body_parts(self) -> tuple[str, ...]:
        """The rows of a frame's content."""
        return self.lines.body_parts

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """A frame a line."""
        threading.Thread(target=self._read, name="tracks", daemon=True).start()
        return self.lines.frames_of(self._take, stop)

    def _read(self) -> None:
        while line := self.stream.readline(LIMIT + 2):
            self._waiting.put((line, self.lines.clock()))
        self._waiting.put(None)

    def _take(self, timeout_s: float) -> list[tuple[bytes, int]] | None:
        try:
            line = self._waiting.get(timeout=timeout_s)
        except queue.Empty:
            return []
        return None if line is None else [line]


@dataclass(slots=True)
class MeshTracks:
    """Tracks on a Zenoh key, one JSON object a message; never ends by itself. `listen` before `frames`."""

    key: str
    lines: LineTracks
    _inbox: Inbox = field(default_factory=Inbox)

    @property
    def rate_hz(self) -> float:
        """Nominal: each message says when it was."""
        return self.lines.rate_hz

    @property
    def body_parts(self) -> tuple[str, ...]:
        """The rows of a frame's content."""
        return self.lines.body_parts

    def listen(self, link: Link) -> None:
        """Subscribe to the key on the observer's own link."""
        self._inbox = link.inbox(self.key)

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """A frame a message."""
        return self.lines.frames_of(self._take, stop)

    def _take(self, timeout_s: float) -> list[tuple[bytes, int]]:
        return [(a.payload, a.arrived_ns) for a in self._inbox.take(timeout_s)]
