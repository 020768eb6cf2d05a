"""Frame sources of a foreign tracker: JSON lines on the standard input, or one line a message on a Zenoh key."""

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
from common.text import plural
from observer.camera.base import NOMINAL_HZ, Clock, Report, ignore_report
from observer.foreign.track_line import MAX_BYTES, frame_of_line
from observer.tracks import BODY_PARTS, Frame

log = logging.getLogger("labanmesh.observer")
SILENCE_S = 0.9
"""A tracker without lines for this long is lost: it is reported as degraded within a second, as a camera is."""
TAKE_S = 0.1
WARN_AGAIN_S = 60.0
"""The first rejected line is logged at once, later ones once a minute with their count."""

Take = Callable[[float], list[tuple[bytes, int]] | None]
"""Returns lines with their times of arrival, waiting for at most that many seconds; None at the end of the input."""


@dataclass(slots=True)
class LineTracks:
    """Turns lines into frames, for both sources below. A bad line is counted in `rejected`, logged and dropped."""

    name: str
    report: Report = ignore_report
    clock: Clock = time.time_ns
    rate_hz: float = NOMINAL_HZ
    body_parts: tuple[str, ...] = BODY_PARTS
    rejected: int = 0
    _warned_ns: int | None = None
    _fault: str = ""

    def frames_of(self, take: Take, stop: threading.Event) -> Iterator[Frame]:
        """The frame of each valid line, until the input ends or `stop` is set."""
        newest_ns = self.clock()
        while not stop.is_set():
            lines = take(TAKE_S)
            if lines is None:
                return
            for line, arrived_ns in lines:
                newest_ns = arrived_ns
                frame = self._parse(line, arrived_ns)
                if frame is not None:
                    self._set_fault("")
                    yield frame
            if self.clock() - newest_ns > SILENCE_S * 1e9:
                self._set_fault(f"{self.name}: no tracks for {SILENCE_S:g} s; is the other tracker running?")

    def _parse(self, line: bytes, arrived_ns: int) -> Frame | None:
        if not line.strip():
            return None
        try:
            return frame_of_line(line, self.body_parts, arrived_ns)
        except BadInput as error:
            self.rejected += 1
            if self._warned_ns is None or arrived_ns - self._warned_ns > WARN_AGAIN_S * 1e9:
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

    A thread reads the stream, because a blocking read cannot be stopped; a faster writer has to wait.
    """

    stream: BinaryIO
    lines: LineTracks
    _queue: "queue.Queue[tuple[bytes, int] | None]" = field(default_factory=lambda: queue.Queue(256))

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """One frame per line."""
        threading.Thread(target=self._read, name="tracks", daemon=True).start()
        return self.lines.frames_of(self._take, stop)

    def _read(self) -> None:
        while line := self.stream.readline(MAX_BYTES + 2):
            self._queue.put((line, self.lines.clock()))
        self._queue.put(None)

    def _take(self, timeout_s: float) -> list[tuple[bytes, int]] | None:
        try:
            line = self._queue.get(timeout=timeout_s)
        except queue.Empty:
            return []
        return None if line is None else [line]


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
