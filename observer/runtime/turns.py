"""Observers of one machine that cannot keep up take turns with its processor.

1. Together, each of n observers takes n times as long for a picture as alone, and its posterior is that much older. One
   after the other, each takes the newest picture when its turn comes. None judges fewer pictures by that.
2. There are as many turns at once as processor cores. A turn is a lock on a file in the folder that `labanmesh up`
   makes for the scene, so that it ends with a process that is killed.
3. A process that is stopped during its turn delays another one once, for LONGEST_WAIT_S; then that one goes on without
   turns until it gets the lock.
"""

import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from queue import SimpleQueue
from typing import TextIO

from common import SECOND_NS
from common.parallel import cores
from observer.tracks import Frame, FrameSource

LONGEST_WAIT_S = 1.0
"""No observer waits longer for its turn. It makes no posterior older, because the picture is chosen after it; by
default the last posterior counts for twice as long (fusion.drop_s)."""


@dataclass(frozen=True, slots=True)
class _Turn:
    granted: threading.Event = field(default_factory=threading.Event)
    over: threading.Event = field(default_factory=threading.Event)


class Turns:
    """The turns of one observer. folder: the same for all observers that take turns. cores: how many at once."""

    def __init__(self, folder: Path, cores: Callable[[], int] = cores, longest_wait_s: float = LONGEST_WAIT_S) -> None:
        self._folder, self._cores, self._longest_wait_s = folder, cores, longest_wait_s
        self._wanted: SimpleQueue[_Turn] = SimpleQueue()
        self._turn: _Turn | None = None
        self._thread: threading.Thread | None = None

    def begin(self) -> None:
        """Wait for a turn, but not for long; call `end` when it is over."""
        if self._turn is not None and not self._turn.granted.is_set():
            return  # the one that was too long in coming is still asked for
        if self._thread is None:
            # Only a thread can wait for a lock and give up.
            self._thread = threading.Thread(target=self._lock, name="turns", daemon=True)
            self._thread.start()
        self._turn = _Turn()
        self._wanted.put(self._turn)
        self._turn.granted.wait(self._longest_wait_s)

    def end(self) -> None:
        """The turn is over, if there was one."""
        if self._turn is not None:
            self._turn.over.set()

    def _lock(self) -> None:
        while True:
            turn = self._wanted.get()
            with _locked(self._folder, max(self._cores(), 1)):
                turn.granted.set()
                turn.over.wait()


@contextmanager
def _locked(folder: Path, count: int) -> Iterator[None]:
    """Hold one of `count` locks; none if the folder is gone."""
    with ExitStack() as stack:
        with suppress(OSError):
            _take_lock([stack.enter_context((folder / f"turn-{n}").open("w")) for n in range(count)])
        yield


def _take_lock(files: Sequence[TextIO]) -> None:
    """Lock one of the files, which lasts until it is closed."""
    import fcntl

    for file in files:
        with suppress(BlockingIOError):
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
    fcntl.flock(files[os.getpid() % len(files)], fcntl.LOCK_EX)


@dataclass(frozen=True, slots=True)
class SourceInTurn:
    """The frames of a source for an observer that takes turns while it leaves out frames: then the newest."""

    source: FrameSource
    turns: Turns
    clock: Callable[[], int] = time.time_ns

    @property
    def rate_hz(self) -> float:
        """The rate of the source."""
        return self.source.rate_hz

    @property
    def body_parts(self) -> Sequence[str]:
        """The body parts of the source."""
        return self.source.body_parts

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """Frames of the source, of which more are left out. The last one of a recording never is."""
        frames = self.source.frames(stop)
        for frame in frames:
            if not frame.skipped or frame.last:
                yield frame
                continue
            self.turns.begin()
            try:
                yield self._newest(frame, frames)
            finally:
                self.turns.end()

    def _newest(self, frame: Frame, frames: Iterator[Frame]) -> Frame:
        """The frame, or the newest one if there must be a newer one now."""
        if self.clock() - frame.captured_ns < SECOND_NS / self.source.rate_hz:
            return frame
        newer = next(frames, None)
        return frame if newer is None else replace(newer, skipped=frame.skipped + 1 + newer.skipped)
