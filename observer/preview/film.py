"""A film of what an observer sees while it works: a thread paints it and never slows the observer."""

import logging
import queue
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Self

import cv2

from common import SECOND_NS
from common.errors import BadInput, LabanmeshError
from common.text import plural
from observer.camera.capture import silence_opencv
from observer.preview.drawing import SIZE
from observer.preview.painting import paint
from observer.preview.sight import Picture, Sighting

log = logging.getLogger("labanmesh.observer")

CODECS = {".mp4": "mp4v", ".avi": "MJPG"}
LONGEST_PAUSE_S = 2.0
"""Longest pause in a film; a longer silence of the camera is cut to it."""
QUEUE_SIZE = 8
"""Pictures that may wait for painting when all are kept; then the observer waits."""
THREAD_CHECK_S = 0.2
"""Interval at which a waiting observer checks that the painting thread still works."""


class Film:
    """A video file, written under a temporary name until it is closed, so that it is complete or absent.

    rate_hz: frame rate of the film. keep_all: one film frame per picture; otherwise the film keeps real time and
    repeats or drops pictures. size_px: of the pictures, width and height. Raises BadInput when it cannot be written.
    """

    def __init__(self, path: Path, rate_hz: float, keep_all: bool, *, size_px: tuple[int, int] = SIZE) -> None:
        self._path, self._rate_hz, self._keep_all = path, rate_hz, keep_all
        self._partial = path.with_name(f"{path.stem}.part{path.suffix}")
        silence_opencv()
        _check_writable(self._partial, path)
        codec = cv2.VideoWriter.fourcc(*CODECS[path.suffix.lower()])
        self._writer = cv2.VideoWriter(str(self._partial.absolute()), cv2.CAP_FFMPEG, codec, rate_hz, size_px)
        if not self._writer.isOpened():
            self._partial.unlink(missing_ok=True)
            raise BadInput(f"{path}: this OpenCV cannot write it at {rate_hz:g} Hz; use a name that ends in .avi")
        self._begin_ns: int | None = None
        self._written = 0

    def draw(self, picture: Picture, shown_ns: int) -> None:
        """Write the picture once, or as often as real time requires."""
        for _ in range(1 if self._keep_all else self._due(shown_ns)):
            self._writer.write(picture)
            self._written += 1

    def _due(self, shown_ns: int) -> int:
        if self._begin_ns is None:
            self._begin_ns = shown_ns
        due = round((shown_ns - self._begin_ns) / SECOND_NS * self._rate_hz) + 1 - self._written
        excess = due - max(1, round(LONGEST_PAUSE_S * self._rate_hz))
        if excess > 0:
            self._begin_ns += round(excess / self._rate_hz * SECOND_NS)
        return max(0, due - max(0, excess))

    def close(self) -> None:
        """Give the file its name; a film without pictures is removed."""
        self._writer.release()
        if not self._written:
            self._partial.unlink(missing_ok=True)
            log.warning("%s: not written: no picture was shown", self._path)
            return
        self._partial.replace(self._path)
        log.info("%s: %s", self._path, plural(self._written, "picture"))


def _check_writable(partial: Path, path: Path) -> None:
    """Raise BadInput unless `partial` can be created and then renamed to `path`."""
    try:
        partial.open("wb").close()
    except OSError as error:
        raise BadInput(f"cannot write {path}: {error.strerror}. Choose another path") from None
    if path.is_dir():
        partial.unlink()
        raise BadInput(f"cannot write {path}: it is a folder. Name a file in it")


class FilmPreview:
    """Paints sightings in a thread, as a context manager. Errors are logged once and never stop the observer.

    keep_all: paint every picture even if the observer must wait, for recordings played as fast as possible; otherwise a
    newer picture replaces a waiting one. clock: a monotonic one, ns.
    """

    def __init__(
        self, film: Film, title: str, keep_all: bool = False, clock: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._film, self._title, self._keep_all, self._clock = film, title, keep_all, clock
        self._queue: queue.Queue[tuple[int, float, Sighting] | None] = queue.Queue(QUEUE_SIZE if keep_all else 1)
        self._thread = threading.Thread(target=self._work, name="preview", daemon=True)
        self._thread.start()

    @classmethod
    def open(cls, target: str, rate_hz: float, title: str, *, keep_all: bool = False) -> Self:
        """A film FILE.mp4 or FILE.avi; raises BadInput for another name and for a file that cannot be written."""
        path = Path(target)
        if path.suffix.lower() not in CODECS:
            raise BadInput(f"--preview {target!r}: FILE.mp4 or FILE.avi is expected; live pictures: picture_hz")
        return cls(Film(path, rate_hz, keep_all), title, keep_all)

    def is_due(self, now_ns: int) -> bool:
        """Always: the thread leaves out what it cannot paint."""
        return True

    def show(self, sighting: Sighting, now_ns: int) -> None:
        """Queue a sighting, which may not be changed afterwards. Waits only when all pictures are kept."""
        item = self._clock(), (now_ns - sighting.captured_ns) / SECOND_NS, sighting
        if self._keep_all:
            self._put(item)
            return
        with suppress(queue.Empty):
            self._queue.get_nowait()
        # There is room, since only this thread puts anything.
        self._queue.put_nowait(item)

    def close(self) -> None:
        """Paint all waiting frames and complete the file. A second call does nothing."""
        self._put(None)
        self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _put(self, item: tuple[int, float, Sighting] | None) -> None:
        while self._thread.is_alive():
            try:
                self._queue.put(item, timeout=THREAD_CHECK_S)
            except queue.Full:
                continue
            return

    def _work(self) -> None:
        """The thread: paint until None comes or nothing more can be written."""
        try:
            try:
                while (item := self._queue.get()) is not None:
                    shown_ns, age_s, sighting = item
                    self._film.draw(paint(sighting, f"{self._title}, {1000 * age_s:.0f} ms old"), shown_ns)
            finally:
                self._film.close()
        except (LabanmeshError, OSError) as error:
            log.warning("preview: %s", error)
