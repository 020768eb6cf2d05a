"""Recorded pictures, played in real time, faster, or as fast as possible: every one, and never ahead of time."""

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from observer.camera.base import Clock, Picture, Size
from observer.camera.sight import SECOND_NS
from observer.source import wait_until
from observer.tracks import Frame


@dataclass(frozen=True, slots=True)
class RecordedPictures:
    """Plays pictures as `observer.source.RecordedMotion` plays motion: a PictureSource that ends after the last.

    Picture i is captured at start + i / rate / speed; without `start_ns` that is now. speed 0: no waiting, and the
    time of capture is the time of playing. When the observer is slower, pictures come late and none is left out.
    pictures: begins at the first each time it is called. count: how many the file says that it holds.
    """

    pictures: Callable[[], Iterator[Picture]] = field(repr=False)
    rate_hz: float
    size_px: Size
    count: int
    speed: float = 1.0
    loop: bool = False
    start_ns: int | None = None
    clock: Clock = time.time_ns
    body_parts: tuple[str, ...] = ()

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """Each picture when it is due. Raises BadInput when the files are no longer what they were at opening."""
        start_ns = self.clock() if self.start_ns is None else self.start_ns
        for i, picture in enumerate(self._all()):
            offset_ns = round(i * SECOND_NS / self.rate_hz / self.speed) if self.speed else 0
            captured_ns = wait_until(start_ns + offset_ns, self.speed, stop, self.clock)
            if captured_ns is None:
                return
            yield Frame(captured_ns, picture, round(i * SECOND_NS / self.rate_hz))

    def _all(self) -> Iterator[Picture]:
        yield from self.pictures()
        while self.loop:
            yield from self.pictures()
