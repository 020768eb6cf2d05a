"""Foreign trackers: 2-D positions that another program has found, one JSON object a line (docs/guide/cameras.md).

The lines come on the standard input, or one a message on a Zenoh key.
"""

import logging
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Annotated, BinaryIO

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from common import SECOND_NS
from common.errors import BadInput
from common.inbox import Inbox
from common.link import Link
from common.text import plural
from observer.camera.base import NOMINAL_HZ, Report, ignore_report
from observer.motion.playback import FrameSkipper
from observer.tracking.person_keeper import PersonKeeper, detection_of, rows_of_people, seen_people
from observer.tracks import BODY_PARTS, Clock, Frame, Tracks

LARGEST_COORDINATE = 1e12
"""Of a coordinate, in any unit: the squares of larger ones would overflow float32, and the model would say NaN."""
Coordinate = Annotated[FiniteFloat, Field(ge=-LARGEST_COORDINATE, le=LARGEST_COORDINATE)]
Position = tuple[Coordinate, Coordinate] | tuple[Coordinate, Coordinate, Annotated[FiniteFloat, Field(ge=0, le=1)]]
MAX_BYTES = 64 * 1024
"""Longest line; trackers with hundreds of key points stay below it."""
LATEST_NS = 2**63 - 1
"""The last time that a message can carry: the year 2262."""
SEEN_CONFIDENCE = 0.5
"""Confidence from which a part counts as seen, as most trackers mean theirs; below it the position is a guess."""
EXAMPLE = '{"captured_ns": 1700000000000000000, "parts": {"left_hand": [412, 300, 0.9], "right_hand": null}}'


class TrackLine(BaseModel):
    """The keys of a line. parts: name -> [u, v] or [u, v, confidence], u right, v DOWN, any unit; null: not seen.

    captured_ns: capture time (Unix epoch, ns); without it the time of arrival counts. Unknown keys are ignored, since
    trackers send more than is needed here.
    """

    model_config = ConfigDict(extra="ignore", frozen=True)
    captured_ns: Annotated[int, Field(gt=0, le=LATEST_NS)] | None = None
    parts: dict[str, Position | None]


def frame_of_line(line: bytes, body_parts: Sequence[str], arrived_ns: int) -> Frame:
    """A frame whose content is (P, 3): u, v and confidence (1 where absent) of `body_parts`; a row of NaN: not seen.

    Raises BadInput, one line, for a malformed line, a capture time out of range and a line without any of the parts.
    """
    if len(line) > MAX_BYTES:
        raise BadInput(f"{len(line)} bytes in one line; at most {MAX_BYTES} are read")
    try:
        message = TrackLine.model_validate_json(line)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "the line"
        raise BadInput(f"{where}: {first['msg']}; e.g. {EXAMPLE}") from None
    if not any(part in message.parts for part in body_parts):
        raise BadInput(f"parts: {', '.join(message.parts) or 'none'}; known: {', '.join(body_parts)}")
    rows = np.full((len(body_parts), 3), np.nan)
    for row, part in enumerate(body_parts):
        position = message.parts.get(part)
        if position is not None:
            rows[row] = (*position, 1.0)[:3]
    return Frame(message.captured_ns or arrived_ns, rows)


class ForeignTracker:
    """A `Tracker` of frames whose content is (P, 3): u, v, confidence 0 to 1; NaN: not seen."""

    def __init__(self, body_parts: Sequence[str]) -> None:
        self.body_parts = tuple(body_parts)

    def update(self, frame: Frame) -> Tracks:
        """Centres where the confidence is at least SEEN_CONFIDENCE, guesses below."""
        sure = frame.content[:, 2:] >= SEEN_CONFIDENCE
        positions = frame.content[:, :2].astype(np.float64)
        return Tracks(np.where(sure, positions, np.nan), np.where(sure, np.nan, positions))


class ForeignPeople:
    """A `Tracker` of several people, at most `most`, of frames as `ForeignTracker` reads them; recorded: their rows."""

    def __init__(self, recorded: Sequence[str], most: int) -> None:
        self.body_parts, self._rows = rows_of_people(recorded)
        self._keeper, self.most = PersonKeeper(most), most

    def update(self, frame: Frame) -> Tracks:
        """The people who are seen, whichever of the rows they have in this frame."""
        bodies = []
        for rows in self._rows:
            content = frame.content[rows]
            centres = np.where(content[:, 2:] >= SEEN_CONFIDENCE, content[:, :2].astype(np.float64), np.nan)
            body = detection_of(centres, centres[np.isfinite(centres).all(axis=1)])
            bodies += [] if body is None else [body]
        persons = self._keeper.update(bodies, frame.at_ns)
        nobody = np.full((len(self.body_parts), 2), np.nan)
        return Tracks(persons[0].centres if persons else nobody, people=seen_people(persons), persons=persons)


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

    Of the lines that wait for an observer that is too slow, the newest is delivered (`FrameSkipper`). rate_hz: nominal,
    each line carries its own time.
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


class PipedTracks:
    """Tracks as JSON lines on a stream, e.g. the standard input; ends when the stream does.

    A thread reads the stream, because a blocking read cannot be stopped.
    """

    def __init__(self, stream: BinaryIO, lines: LineTracks) -> None:
        self.stream, self.lines, self.rate_hz, self.body_parts = stream, lines, lines.rate_hz, lines.body_parts
        self._queue, self._ended = queue.Queue[Line | None](QUEUE_LINES), False

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


class MeshTracks:
    """Tracks on a Zenoh key, one JSON object a message; never ends by itself. Call `listen` before `frames`."""

    def __init__(self, key: str, lines: LineTracks) -> None:
        self.key, self.lines, self.rate_hz, self.body_parts = key, lines, lines.rate_hz, lines.body_parts
        self._inbox = Inbox()

    def listen(self, link: Link) -> None:
        """Subscribe to the key on the observer's own link."""
        self._inbox = link.inbox(self.key)

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """One frame per message."""
        return self.lines.frames_of(self._take, stop)

    def _take(self, timeout_s: float) -> list[tuple[bytes, int]]:
        return [(a.payload, a.arrived_ns) for a in self._inbox.take(timeout_s)]
