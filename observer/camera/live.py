"""Live cameras: a thread reads every picture, the observer takes the newest, faults and recoveries are reported.

1. A camera that cannot be opened or read is lost until it delivers a picture again.
2. A camera that delivers nothing for `silence_s` is lost.
3. A camera whose pictures are identical for `same_s` is frozen: sensor noise makes real pictures differ.
4. A lost camera is opened again after a wait that doubles with each failure. The wait starts over only for a camera
   that had delivered for `steady_s`, so that a camera that dies at every start is opened less and less often.
"""

import logging
import threading
import time
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

from common import SECOND_NS
from common.backoff import Backoff
from common.errors import LabanmeshError
from observer.camera.base import NOMINAL_HZ, CameraFault, Report, ignore_report
from observer.camera.capture import Connect, OpenCvCamera
from observer.tracks import Clock, Frame, Picture, Size, size_of

log = logging.getLogger("labanmesh.observer")

STRIDE = 8
"""`digest` reads every 8th pixel of every 8th row: 1/64 of the bytes, and still thousands of noisy pixels."""
STOP_S = 0.1
"""Interval at which a thread that waits for a picture checks whether to stop."""
JOIN_S = 3.0
"""Timeout for a camera to return from a blocking call; longer than the timeouts of such calls."""
REOPENING = Backoff(0.25, 8.0, 2.0)
"""Rule 4: the wait before a lost camera is opened again."""


@dataclass(frozen=True, slots=True)
class CameraTimeouts:
    """Seconds for which a camera may deliver nothing (`silence_s`) or the same picture (`same_s`).

    An observer reports `degraded` within one second; the missing tenth is for noticing and reporting.
    """

    silence_s: float = 0.9
    same_s: float = 1.0


@dataclass(frozen=True, slots=True)
class CameraHistory:
    """What is known of a live camera; times in ns of one monotonic clock.

    newest_ns: time of the newest picture, or of the start when there is none yet. changed_ns: time of the newest
    picture that differed from its predecessor, or of the start. fault: why the camera is lost; "" while it delivers.
    """

    newest_ns: int
    changed_ns: int
    fault: str = ""


@dataclass(frozen=True, slots=True)
class CameraHealth:
    """State of a camera, and the reason in words; "" while it delivers."""

    state: Literal["delivering", "lost", "frozen"]
    reason: str = ""


def assess(history: CameraHistory, now_ns: int, timeouts: CameraTimeouts) -> CameraHealth:
    """The camera's health at `now_ns`: the first of rules 1 to 3 that applies."""
    if history.fault:
        return CameraHealth("lost", history.fault)
    if now_ns - history.newest_ns >= timeouts.silence_s * SECOND_NS:
        return CameraHealth("lost", f"no picture for {timeouts.silence_s:g} s")
    # Measured from picture to picture: a slow camera is not a frozen one.
    if history.newest_ns - history.changed_ns >= timeouts.same_s * SECOND_NS:
        return CameraHealth("frozen", f"frozen: the same picture for {timeouts.same_s:g} s")
    return CameraHealth("delivering")


def silent_in_s(history: CameraHistory, now_ns: int, timeouts: CameraTimeouts) -> float:
    """Seconds from `now_ns` until rule 2 applies if no picture comes; 0 when it applies already."""
    return max(0.0, timeouts.silence_s - (now_ns - history.newest_ns) / SECOND_NS)


def digest(picture: Picture) -> int:
    """A checksum that is equal for identical pictures and, by sensor noise, differs between real ones."""
    return zlib.crc32(picture[::STRIDE, ::STRIDE].tobytes())


@dataclass(frozen=True, slots=True)
class LiveCamera:
    """A FrameSource whose camera may fail, freeze and return; ends only when stopped.

    name: for people, without secrets. rate_hz: requested from the camera and used by the model; fewer may come.
    size_px: required size of the pictures; None takes the size of the first. ticks: a monotonic clock.
    Every fault and every recovery is reported. Each frame is the newest, and none is passed on while frozen.
    """

    name: str
    connect: Connect = field(repr=False)
    report: Report = ignore_report
    rate_hz: float = NOMINAL_HZ
    size_px: Size | None = None
    timeouts: CameraTimeouts = field(default_factory=CameraTimeouts)
    backoff: Backoff = REOPENING
    ticks: Clock = time.monotonic_ns
    body_parts: tuple[str, ...] = ()

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """Wait for the newest frame that was not delivered yet, again and again. One caller at a time.

        Raises LabanmeshError when the reading thread ends with an unexpected error.
        """
        latest, ended = LatestFrame(self.ticks()), threading.Event()
        thread = threading.Thread(target=self._read, args=(latest, ended), name=f"camera {self.name}", daemon=True)
        thread.start()
        try:
            yield from self._deliver(latest, stop, thread)
        finally:
            ended.set()
            thread.join(JOIN_S)

    def _deliver(self, latest: "LatestFrame", stop: threading.Event, thread: threading.Thread) -> Iterator[Frame]:
        reported, wait_s = CameraHealth("delivering"), STOP_S
        while not stop.is_set():
            frame, history = latest.take(wait_s)
            health = assess(history, self.ticks(), self.timeouts)
            if health != reported:
                self._report(health)
                reported = health
            if frame is not None and health.state != "frozen":
                yield frame
            elif not thread.is_alive():
                raise LabanmeshError(f"{self.name}: the thread that reads its pictures failed; restart the observer")
            # 0 means silent already: then only `stop` needs checking.
            wait_s = min(silent_in_s(history, self.ticks(), self.timeouts) or STOP_S, STOP_S)

    def _report(self, health: CameraHealth) -> None:
        if health.state == "delivering":
            log.info("%s: delivers pictures again", self.name)
            self.report("running", "")
        else:
            log.warning("%s: %s", self.name, health.reason)
            self.report("degraded", f"{self.name}: {health.reason}")

    def _read(self, latest: "LatestFrame", ended: threading.Event) -> None:
        """The thread: open, read until it fails, wait, again."""
        failures, size_px = 0, self.size_px
        while not ended.is_set():
            began_ns = self.ticks()
            try:
                camera = self.connect()
                began_ns = self.ticks()
                try:
                    while not ended.is_set():
                        size_px = self._pass_on(camera, latest, size_px)
                finally:
                    camera.close()
            except CameraFault as fault:
                latest.fail(str(fault))
                failures = self.backoff.failures(failures, (self.ticks() - began_ns) / SECOND_NS)
                ended.wait(self.backoff.wait_s(failures))

    def _pass_on(self, camera: OpenCvCamera, latest: "LatestFrame", size_px: Size | None) -> Size:
        captured_ns, picture = camera.read()
        size = size_of(picture)
        if size_px not in (None, size):
            width, height = size_px or size
            raise CameraFault(f"delivers {size[0]}x{size[1]} px, not {width}x{height} as before or as calibrated")
        latest.put(captured_ns, picture, self.ticks())
        return size


class LatestFrame:
    """Holds one frame between two threads, and the camera's history; a new frame replaces one that was not taken."""

    def __init__(self, now_ns: int) -> None:
        self._changed = threading.Condition()
        self._has_news = False
        self._frame: Frame | None = None
        self._history = CameraHistory(now_ns, now_ns)
        self._digest: int | None = None
        self._skipped = 0

    def put(self, captured_ns: int, picture: Picture, now_ns: int) -> None:
        """Store a picture that arrived at `now_ns`."""
        checksum = digest(picture)
        with self._changed:
            same = checksum == self._digest
            self._digest = checksum
            self._skipped = 0 if self._frame is None else self._skipped + 1
            self._frame = Frame(captured_ns, picture, skipped=self._skipped)
            self._history = CameraHistory(now_ns, self._history.changed_ns if same else now_ns)
            self._notify()

    def fail(self, reason: str) -> None:
        """Record that the camera was lost."""
        with self._changed:
            self._history = CameraHistory(self._history.newest_ns, self._history.changed_ns, reason)
            self._notify()

    def take(self, wait_s: float) -> tuple[Frame | None, CameraHistory]:
        """The newest frame not taken yet, or None; waits for a change for at most `wait_s` seconds."""
        with self._changed:
            self._changed.wait_for(lambda: self._has_news, wait_s)
            frame, self._frame, self._has_news = self._frame, None, False
            return frame, self._history

    def _notify(self) -> None:
        self._has_news = True
        self._changed.notify()
