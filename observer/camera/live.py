"""Live cameras: a thread takes every picture and keeps the newest, the observer gets that one, troubles are told."""

import logging
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field

from common.errors import LabanmeshError
from observer.camera.base import NOMINAL_HZ, CameraFault, Clock, Picture, Report, Size, frame_of, size_of, unheard
from observer.camera.capture import Camera, Connect
from observer.camera.sight import SECOND_NS, Backoff, Judgement, Patience, Seen, digest, judge, silent_in_s
from observer.tracks import Frame

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
    patience: Patience = field(default_factory=Patience)
    backoff: Backoff = field(default_factory=Backoff)
    ticks: Clock = time.monotonic_ns
    body_parts: tuple[str, ...] = ()

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """Each time the newest frame that was not given yet; waits for one. One caller at a time.

        Raises LabanmeshError if the thread that takes the pictures broke, which only a defect of ours can do.
        """
        newest, ended = Newest(self.ticks()), threading.Event()
        thread = threading.Thread(target=self._grab, args=(newest, ended), name=f"camera {self.name}", daemon=True)
        thread.start()
        try:
            yield from self._watch(newest, stop, thread)
        finally:
            ended.set()
            thread.join(FAREWELL_S)

    def _watch(self, newest: "Newest", stop: threading.Event, thread: threading.Thread) -> Iterator[Frame]:
        told, wait_s = Judgement("sees"), STOP_S
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

    def _tell(self, found: Judgement) -> None:
        if found.sight == "sees":
            log.info("%s: sees again", self.name)
            self.report("running", "")
        else:
            log.warning("%s: %s", self.name, found.reason)
            self.report("degraded", f"{self.name}: {found.reason}")

    def _grab(self, newest: "Newest", ended: threading.Event) -> None:
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

    def _pass_on(self, camera: Camera, newest: "Newest", size_px: Size | None) -> Size:
        captured_ns, picture = camera.read()
        size = size_of(picture)
        if size_px not in (None, size):
            width, height = size_px or size
            raise CameraFault(f"delivers {size[0]}x{size[1]} px, not {width}x{height} as before or as calibrated")
        newest.put(captured_ns, picture, self.ticks())
        return size


class Newest:
    """Room for one frame between two threads, and what is known of the camera; a new frame replaces one not taken."""

    def __init__(self, now_ns: int) -> None:
        self._news = threading.Condition()
        self._any = False
        self._frame: Frame | None = None
        self._seen = Seen(now_ns, now_ns)
        self._digest: int | None = None

    def put(self, captured_ns: int, picture: Picture, now_ns: int) -> None:
        """A picture that has come at `now_ns`."""
        found = digest(picture)
        with self._news:
            same = found == self._digest
            self._digest = found
            self._frame = frame_of(captured_ns, picture)
            self._seen = Seen(now_ns, self._seen.changed_ns if same else now_ns)
            self._tell()

    def fail(self, reason: str) -> None:
        """The camera was lost."""
        with self._news:
            self._seen = Seen(self._seen.newest_ns, self._seen.changed_ns, reason)
            self._tell()

    def take(self, wait_s: float) -> tuple[Frame | None, Seen]:
        """The newest frame, or None if there is none that was not taken; waits for news, at most so many seconds."""
        with self._news:
            self._news.wait_for(lambda: self._any, wait_s)
            frame, self._frame, self._any = self._frame, None, False
            return frame, self._seen

    def _tell(self) -> None:
        self._any = True
        self._news.notify()
