"""A clip for each verdict, kept on the observer's own machine: the last seconds in memory, and a thread that writes.

1. Only JPEGs wait in memory, at most CLIP_HZ a second for as long as a clip is, and each of bounded size.
2. Whatever fails when a clip is written is one line in the log. The observer never waits for the disk.
"""

import logging
import queue
import struct
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from common import SECOND_NS
from common.clip_name import clip_name
from common.errors import LabanmeshError, reason_of
from common.inbox import Inbox
from common.messages import StatusMessage, VerdictMessage
from common.same_movement import JudgingServices, SameMovement
from common.text import plural
from common.vocabulary import ABSTAIN, Vocabulary
from common.wire import BadMessage, decode_from
from observer.preview.clip_folder import ClipFolder
from observer.preview.small_picture import Sighting, encode_jpeg, small_picture

log = logging.getLogger("labanmesh.observer")

CLIP_HZ = 10.0
CLIP_SIDE_PX = 640
JPEG_BYTES = 80_000
"""Most bytes of one picture: with CLIP_HZ and a minute 48 MB at most."""
CLIPS_WAITING = 8
"""Clips that may wait for a slow disk."""
PENDING_CLIPS_LIMIT = 64
"""Verdicts whose clips are not over: a clip lasts a minute at most, and nobody does a movement each second."""
VERDICTS_KNOWN = 256
"""So many verdicts are remembered."""
CLEAN_S = 600.0
"""Interval at which old clips are deleted also when nothing happens."""
LAST_CLIPS_S = 5.0


@dataclass(frozen=True, slots=True)
class _Picture:
    shown_ns: int
    jpeg: bytes
    size_px: tuple[int, int]


@dataclass(frozen=True, slots=True)
class _DecidedVerdict:
    """A verdict whose clip is not over yet, by this machine's clock."""

    label: str
    decided_ns: int


class VerdictClips:
    """Writes a clip for each decided verdict; a context manager.

    arrived: verdicts, and the statuses of the fusion services. seconds: of the clip, before and after the verdict has
    arrived. vocabulary: the observer's now; verdicts of other movements, and of processes that are no fusion service of
    the scene, are left out and counted in `left_out`, because anybody may publish on a mesh without certificates.
    clock: this machine's time, ns since the epoch.
    """

    def __init__(
        self,
        arrived: Inbox,
        folder: ClipFolder,
        observer: str,
        seconds: tuple[float, float],
        vocabulary: Callable[[], Vocabulary | None],
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        self._arrived, self._observer, self._vocabulary, self._clock = arrived, observer, vocabulary, clock
        self._services, self.left_out = JudgingServices(), 0
        self._before_ns, self._after_ns = (round(each * SECOND_NS) for each in seconds)
        self._pictures: deque[_Picture] = deque(maxlen=round(sum(seconds) * CLIP_HZ) + 2)
        self._next_ns = 0
        self._same, self._known = SameMovement(), OrderedDict[str, None]()
        self._pending: dict[str, _DecidedVerdict] = {}
        self._writer = _ClipWriter(folder, clock)

    def is_due(self, now_ns: int) -> bool:
        """Whether a picture is wanted at `now_ns`; also takes what has arrived, and completes clips."""
        self._take(now_ns)
        return not now_ns < self._next_ns <= now_ns + SECOND_NS / CLIP_HZ

    def show(self, sighting: Sighting, now_ns: int) -> None:
        """Keep one picture for as long as a clip may need it."""
        every_ns = round(SECOND_NS / CLIP_HZ)
        self._next_ns = (self._next_ns if 0 <= now_ns - self._next_ns < every_ns else now_ns) + every_ns
        self._pictures.append(_Picture(now_ns, *encode_jpeg(small_picture(sighting, CLIP_SIDE_PX), JPEG_BYTES)))

    def close(self) -> None:
        """Write the clips that are not over with what there is."""
        self._take(self._clock())
        for verdict_id in tuple(self._pending):
            self._complete(verdict_id)
        if self.left_out:
            log.warning("%s: no clips of %s", self._observer, plural(self.left_out, "other verdict"))
        self._writer.close()

    def _take(self, now_ns: int) -> None:
        for arrival in self._arrived.take(0.0):
            try:
                if arrival.key.endswith("/status"):
                    self._services.hear(decode_from(arrival.key, StatusMessage, arrival.payload))
                    continue
                verdict = decode_from(arrival.key, VerdictMessage, arrival.payload)
            except BadMessage:
                continue  # the hubs and the fusion service count and report these
            self._note(verdict, arrival.arrived_ns)
        for verdict_id, pending in tuple(self._pending.items()):
            if now_ns - pending.decided_ns >= self._after_ns:
                self._complete(verdict_id)

    def _note(self, judged: VerdictMessage, arrived_ns: int) -> None:
        vocabulary = self._vocabulary()
        is_known = vocabulary is not None and judged.label in (ABSTAIN, *vocabulary.labels)
        if not (is_known and self._services.knows(judged)):
            self._leave_out()
            return
        verdict = self._same.take(judged)
        if verdict is None:
            return
        is_new = verdict.id not in self._known and verdict.id not in self._pending
        if is_new and len(self._pending) >= PENDING_CLIPS_LIMIT:
            self._leave_out()
            return
        if verdict.id in self._pending and verdict.label != ABSTAIN:
            self._pending[verdict.id] = replace(self._pending[verdict.id], label=verdict.label)
        if verdict.id in self._known or verdict.label == ABSTAIN:
            return
        self._known[verdict.id] = None
        if len(self._known) > VERDICTS_KNOWN:
            self._known.popitem(last=False)
        self._pending[verdict.id] = _DecidedVerdict(verdict.label, arrived_ns)

    def _leave_out(self) -> None:
        if not self.left_out:
            log.warning("%s: no clips of verdicts that are of none of its movements, or nobody's", self._observer)
        self.left_out += 1

    def _complete(self, verdict_id: str) -> None:
        pending = self._pending.pop(verdict_id)
        began_ns, ended_ns = pending.decided_ns - self._before_ns, pending.decided_ns + self._after_ns
        pictures = tuple(each for each in self._pictures if began_ns <= each.shown_ns <= ended_ns)
        name = clip_name(pending.decided_ns, self._observer, pending.label, verdict_id)
        if pictures:
            self._writer.write(name, pictures)
        else:
            log.warning("%s: not written: the observer has shown no picture in these seconds", name)


class _ClipWriter:
    """A thread that writes clips and deletes old ones."""

    def __init__(self, folder: ClipFolder, clock: Callable[[], int]) -> None:
        self._folder, self._clock = folder, clock
        self._waiting: queue.Queue[tuple[str, tuple[_Picture, ...]] | None] = queue.Queue(CLIPS_WAITING)
        self._fault = ""
        self._thread = threading.Thread(target=self._work, name="clips", daemon=True)
        self._thread.start()

    def write(self, name: str, pictures: tuple[_Picture, ...]) -> None:
        try:
            self._waiting.put_nowait((name, pictures))
        except queue.Full:
            log.warning("%s: not written: %d clips wait for a slow disk", name, CLIPS_WAITING)

    def close(self) -> None:
        try:
            self._waiting.put(None, timeout=LAST_CLIPS_S)
        except queue.Full:
            return
        self._thread.join(LAST_CLIPS_S)

    def _work(self) -> None:
        clean = partial(self._attempt, lambda: self._folder.delete_old(self._clock()))
        clean()
        while True:
            try:
                clip = self._waiting.get(timeout=CLEAN_S)
            except queue.Empty:
                clean()
                continue
            if clip is None:
                return
            self._attempt(partial(self._write, *clip))

    def _write(self, name: str, pictures: tuple[_Picture, ...]) -> None:
        newest = pictures[-1]
        # A camera that is replaced may change its size; a film has one.
        jpegs = [each.jpeg for each in pictures if each.size_px == newest.size_px]
        span_s = (newest.shown_ns - pictures[0].shown_ns) / SECOND_NS
        rate_hz = (len(pictures) - 1) / span_s if span_s > 0 else CLIP_HZ
        path = self._folder.add(name, motion_jpeg(jpegs, newest.size_px, rate_hz), self._clock())
        log.info("%s: %.1f s", path, span_s)

    def _attempt(self, action: Callable[[], object]) -> None:
        """Do it; a failure is logged once, until something succeeds."""
        try:
            action()
        except (LabanmeshError, OSError) as error:
            fault = f"{error.filename}: {reason_of(error)}" if isinstance(error, OSError) else str(error)
            # The name of the file differs each time, the reason does not.
            kind = type(error.__cause__ or error).__name__
            if kind != self._fault:
                log.warning("no clip kept: %s; the observer goes on", fault)
            self._fault = kind
        else:
            self._fault = ""


MICROSECONDS = 1_000_000
HAS_INDEX = 0x10
KEY_FRAME = 0x10


def motion_jpeg(jpegs: Sequence[bytes], size_px: tuple[int, int], rate_hz: float) -> bytes:
    """An AVI file of JPEGs as they are (Motion JPEG); size_px: width and height of each.

    Source: Microsoft, AVI RIFF File Reference.
    """
    chunks = [_chunk(b"00dc", jpeg) for jpeg in jpegs]
    places, place = [], 4
    for chunk in chunks:
        places.append(place)
        place += len(chunk)
    index = b"".join(
        struct.pack("<4sIII", b"00dc", KEY_FRAME, at, len(jpeg)) for at, jpeg in zip(places, jpegs, strict=True)
    )
    header = _header(len(jpegs), max(map(len, jpegs)), size_px, rate_hz)
    body = b"".join([header, _chunk(b"LIST", b"".join([b"movi", *chunks])), _chunk(b"idx1", index)])
    return _chunk(b"RIFF", b"AVI " + body)


def _header(frames: int, largest: int, size_px: tuple[int, int], rate_hz: float) -> bytes:
    width, height = size_px
    per_frame = round(MICROSECONDS / rate_hz)
    main = struct.pack(
        "<14I", per_frame, round(largest * rate_hz), 0, HAS_INDEX, frames, 0, 1, largest, width, height, 0, 0, 0, 0
    )
    stream = struct.pack(
        "<4s4sIHHIIIIIIII4H", b"vids", b"MJPG", 0, 0, 0, 0, per_frame, MICROSECONDS, 0, frames, largest, 0xFFFFFFFF, 0,
        0, 0, width, height,
    )  # fmt: skip
    picture = struct.pack("<IiiHH4sIiiII", 40, width, height, 1, 24, b"MJPG", 3 * width * height, 0, 0, 0, 0)
    streams = _chunk(b"LIST", b"strl" + _chunk(b"strh", stream) + _chunk(b"strf", picture))
    return _chunk(b"LIST", b"hdrl" + _chunk(b"avih", main) + streams)


def _chunk(name: bytes, content: bytes) -> bytes:
    """A RIFF chunk; its content starts at an even place."""
    return b"".join([name, struct.pack("<I", len(content)), content, b"\0" * (len(content) % 2)])
