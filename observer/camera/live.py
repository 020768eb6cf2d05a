"""Live cameras: a thread reads every picture, the observer gets the newest, faults and recoveries are reported."""

import logging
import threading
import time
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

from common.errors import LabanmeshError
from observer.camera.base import NOMINAL_HZ, CameraFault, Clock, Picture, Report, Size, frame_of, size_of, unheard
from observer.camera.capture import Camera, Connect
from observer.tracks import Frame

SECOND_NS = 1_000_000_000
STRIDE = 8
"""Every 8th pixel of every 8th row tells two pictures apart: 1/64 of the bytes, and still thousands of noisy pixels."""

Sight = Literal["sees", "lost", "frozen"]


@dataclass(frozen=True, slots=True)
class CameraTimeouts:
    """How long, in seconds, a camera may be silent, and deliver the same picture.

    A second is what an observer may take to say that it is degraded; the missing tenth is for noticing and saying.
    """

    silence_s: float = 0.9
    same_s: float = 1.0


@dataclass(frozen=True, slots=True)
class CameraHistory:
    """What is known of a live camera; times in ns of one clock that is never set back.

    newest_ns: of the newest picture, or of the beginning when there is none yet. changed_ns: of the newest picture
    that differed from the one before it, or of the beginning. fault: why it was lost; "" when it delivers.
    """

    newest_ns: int
    changed_ns: int
    fault: str = ""


@dataclass(frozen=True, slots=True)
class CameraHealth:
    """How the camera is, and the reason in words, "" when it sees."""

    sight: Sight
    reason: str = ""


def judge(seen: CameraHistory, now_ns: int, patience: CameraTimeouts) -> CameraHealth:
    """How a camera of which this is known is at `now_ns`: rules 1 to 3, the first that applies."""
    if seen.fault:
        return CameraHealth("lost", seen.fault)
    if now_ns - seen.newest_ns >= patience.silence_s * SECOND_NS:
        return CameraHealth("lost", f"no picture for {patience.silence_s:g} s")
    # From picture to picture: a camera that is merely slow has not shown the same for so long.
    if seen.newest_ns - seen.changed_ns >= patience.same_s * SECOND_NS:
        return CameraHealth("frozen", f"frozen: the same picture for {patience.same_s:g} s")
    return CameraHealth("sees")


def silent_in_s(seen: CameraHistory, now_ns: int, patience: CameraTimeouts) -> float:
    """Seconds from `now_ns` until rule 2 applies if nothing comes; 0 when it does already."""
    return max(0.0, patience.silence_s - (now_ns - seen.newest_ns) / SECOND_NS)


def digest(picture: Picture) -> int:
    """A number that is the same for identical pictures and, by their noise, differs between real ones."""
    return zlib.crc32(picture[::STRIDE, ::STRIDE].tobytes())


@dataclass(frozen=True, slots=True)
class Backoff:
    """Rule 4: the wait before a lost camera is opened again, `first_s` doubled with each failure up to `longest_s`."""

    first_s: float = 0.25
    longest_s: float = 8.0
    steady_s: float = 2.0

    def failures(self, before: int, delivered_s: float) -> int:
        """How many failures in a row there are, after one more by a camera that had delivered for so many seconds."""
        return 1 if delivered_s >= self.steady_s else before + 1

    def wait_s(self, failures: int) -> float:
        """Seconds to wait after so many failures in a row (at least 1)."""
        # 2 ** 60 quarter seconds outlast any camera; without the bound a float would overflow after a night.
        return min(self.first_s * 2.0 ** min(failures - 1, 60), self.longest_s)


log = logging.getLogger("labanmesh.observer")

STOP_S = 0.1
"""So often who waits for a picture looks whether to stop."""
FAREWELL_S = 3.0
"""So long a camera may take to come back from a call that it hangs in: longer than the limits of such calls."""


@dataclass(frozen=True, slots=True)
class LiveCamera:
    """A camera that may fail, freeze and return; a PictureSource that ends only when told to.

    name: for people, without secrets. rate_hz: what the camera is asked for and a model is told; less may come.
    size_px: what the pictures must have; if None, the first decides. ticks: a clock that is never set back.
    Every trouble and every recovery is reported; in between, each frame is the newest, and none comes while frozen.
    """

    name: str
    connect: Connect = field(repr=False)
    report: Report = unheard
    rate_hz: float = NOMINAL_HZ
    size_px: Size | None = None
    patience: CameraTimeouts = field(default_factory=CameraTimeouts)
    backoff: Backoff = field(default_factory=Backoff)
    ticks: Clock = time.monotonic_ns
    body_parts: tuple[str, ...] = ()

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """Each time the newest frame that was not given yet; waits for one. One caller at a time.

        Raises LabanmeshError if the thread that takes the pictures broke, which only a defect of ours can do.
        """
        newest, ended = LatestFrame(self.ticks()), threading.Event()
        thread = threading.Thread(target=self._grab, args=(newest, ended), name=f"camera {self.name}", daemon=True)
        thread.start()
        try:
            yield from self._watch(newest, stop, thread)
        finally:
            ended.set()
            thread.join(FAREWELL_S)

    def _watch(self, newest: "LatestFrame", stop: threading.Event, thread: threading.Thread) -> Iterator[Frame]:
        told, wait_s = CameraHealth("sees"), STOP_S
        while not stop.is_set():
            frame, seen = newest.take(wait_s)
            now_ns = self.ticks()
            found = judge(seen, now_ns, self.patience)
            if found != told:
                self._tell(found)
                told = found
            if frame is not None and found.sight != "frozen":
                yield frame
            elif not thread.is_alive():
                raise LabanmeshError(f"{self.name}: the thread that takes its pictures has broken; start again")
            # 0 means silent already: nothing is then due but the next look at `stop`.
            wait_s = min(silent_in_s(seen, self.ticks(), self.patience) or STOP_S, STOP_S)

    def _tell(self, found: CameraHealth) -> None:
        if found.sight == "sees":
            log.info("%s: sees again", self.name)
            self.report("running", "")
        else:
            log.warning("%s: %s", self.name, found.reason)
            self.report("degraded", f"{self.name}: {found.reason}")

    def _grab(self, newest: "LatestFrame", ended: threading.Event) -> None:
        """The thread: open, read until it fails, wait, again."""
        failures, size_px = 0, self.size_px
        while not ended.is_set():
            began_ns = self.ticks()
            try:
                camera = self.connect()
                began_ns = self.ticks()
                try:
                    while not ended.is_set():
                        size_px = self._pass_on(camera, newest, size_px)
                finally:
                    camera.close()
            except CameraFault as fault:
                newest.fail(str(fault))
                failures = self.backoff.failures(failures, (self.ticks() - began_ns) / SECOND_NS)
                ended.wait(self.backoff.wait_s(failures))

    def _pass_on(self, camera: Camera, newest: "LatestFrame", size_px: Size | None) -> Size:
        captured_ns, picture = camera.read()
        size = size_of(picture)
        if size_px not in (None, size):
            width, height = size_px or size
            raise CameraFault(f"delivers {size[0]}x{size[1]} px, not {width}x{height} as before or as calibrated")
        newest.put(captured_ns, picture, self.ticks())
        return size


class LatestFrame:
    """Room for one frame between two threads, and what is known of the camera; a new frame replaces one not taken."""

    def __init__(self, now_ns: int) -> None:
        self._news = threading.Condition()
        self._any = False
        self._frame: Frame | None = None
        self._seen = CameraHistory(now_ns, now_ns)
        self._digest: int | None = None

    def put(self, captured_ns: int, picture: Picture, now_ns: int) -> None:
        """A picture that has come at `now_ns`."""
        found = digest(picture)
        with self._news:
            same = found == self._digest
            self._digest = found
            self._frame = frame_of(captured_ns, picture)
            self._seen = CameraHistory(now_ns, self._seen.changed_ns if same else now_ns)
            self._tell()

    def fail(self, reason: str) -> None:
        """The camera was lost."""
        with self._news:
            self._seen = CameraHistory(self._seen.newest_ns, self._seen.changed_ns, reason)
            self._tell()

    def take(self, wait_s: float) -> tuple[Frame | None, CameraHistory]:
        """The newest frame, or None if there is none that was not taken; waits for news, at most so many seconds."""
        with self._news:
            self._news.wait_for(lambda: self._any, wait_s)
            frame, self._frame, self._any = self._frame, None, False
            return frame, self._seen

    def _tell(self) -> None:
        self._any = True
        self._news.notify()
