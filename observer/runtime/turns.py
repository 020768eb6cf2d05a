"""Observers of one machine that cannot keep up take turns with its processor.

1. Together, each of n observers takes n times as long for a picture as alone, and its posterior is that much older. One
   after the other, each takes the newest picture when its turn comes. Waiting costs time of its own, so that an
   observer takes turns only while it leaves out pictures for longer than SLOW_S.
2. There are as many turns at once as processor cores, and each observer comes after those that asked before it. A turn
   is a lock on a file in the folder that `labanmesh up` makes for the scene, so that it ends with a process that is
   killed.
3. A process that is stopped during its turn delays another one once, for LONGEST_WAIT_S; then that one goes on without
   turns until it gets the lock.
"""

import itertools
import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from queue import SimpleQueue

from common import SECOND_NS
from common.parallel import cores
from observer.tracks import Frame, FrameSource

SLOW_S = 0.5
"""An observer that needs so long for a picture has posteriors that are as old: the age that they may have at most."""
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
        for number in itertools.count():
            turn = self._wanted.get()
            # Two files are enough: a third request comes after the turn of whoever waits for the first.
            with _locked(self._folder, f"{os.getpid()}-{id(self)}-{number % 2}.turn", max(self._cores(), 1)):
                turn.granted.set()
                turn.over.wait()


@contextmanager
def _locked(folder: Path, name: str, count: int) -> Iterator[None]:
    """Hold the lock of the file `name`, after that of the one before in one of `count` queues; none without folder."""
    import fcntl

    with ExitStack() as stack:
        with suppress(OSError):
            own = stack.enter_context((folder / name).open("w"))
            fcntl.flock(own, fcntl.LOCK_EX)
            queues = [folder / f"{n}.queue" for n in range(count)]
            if not any(_joined(queue, name, wait=False) for queue in queues):
                _joined(queues[os.getpid() % count], name, wait=True)
        yield


def _joined(queue: Path, name: str, wait: bool) -> bool:
    """Whether it is our turn in the queue, in which `name` is the last one then; wait: until it is.

    A queue is a file with the name of the last one's file (Craig; Landin and Hagersten, 1994). Locks alone are unfair:
    who has just had its turn would lock again before another process has noticed.
    """
    import fcntl

    with ExitStack() as stack:
        with queue.open("a+") as last:
            fcntl.flock(last, fcntl.LOCK_EX)
            last.seek(0)
            before = queue.with_name(last.read() or name)
            is_first = before.name == name or not before.exists()
            if not is_first:
                file = stack.enter_context(before.open())
                with suppress(BlockingIOError):
                    fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
                    is_first = True
            if is_first or wait:
                last.truncate(0)
                last.write(name)
        if wait and not is_first:
            fcntl.flock(file, fcntl.LOCK_SH)
    return is_first or wait


@dataclass(frozen=True, slots=True)
class SourceInTurn:
    """The frames of a source for an observer that takes turns while it is slow: then the newest."""

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
        """Frames of the source; in turn while the gaps between them are SLOW_S and more."""
        frames, in_turn = self.source.frames(stop), False
        for frame in frames:
            in_turn = bool(frame.skipped) and not frame.last and (in_turn or self._is_slow(frame))
            if not in_turn:
                yield frame
                continue
            self.turns.begin()
            try:
                newest = self._newest(frame, frames)
                in_turn = self._is_slow(newest)
                yield newest
            finally:
                self.turns.end()

    def _is_slow(self, frame: Frame) -> bool:
        return frame.skipped >= SLOW_S * self.source.rate_hz

    def _newest(self, frame: Frame, frames: Iterator[Frame]) -> Frame:
        """The frame, or the newest one if there must be a newer one now."""
        if self.clock() - frame.captured_ns < SECOND_NS / self.source.rate_hz:
            return frame
        newer = next(frames, None)
        return frame if newer is None else replace(newer, skipped=frame.skipped + 1 + newer.skipped)
