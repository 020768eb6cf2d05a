"""Recordings of a scene begin together, when the last of its observers is ready: a start barrier in a folder.

`labanmesh up` puts a file ID.awaited into it for each observer that plays a recording, and takes that away when the
process has failed. An observer that is ready writes ID.ready with the time, and waits for the others. The first to see
them all writes the begin to `begin`, once and for all.
"""

import logging
import os
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from common import SECOND_NS
from common.text import plural

log = logging.getLogger("labanmesh.observer")

BARRIER = "LABANMESH_PLAYBACK_MEETING"
"""Environment variable: the folder."""
AHEAD_S = 0.3
"""From the moment at which the last one is ready to the begin: all others have noticed it by then."""
BARRIER_TIMEOUT_S = 60.0
"""Longest time for which an observer that is ready waits for the others."""
BARRIER_CHECK_S = 0.03
BEGIN = "begin"


@dataclass(frozen=True, slots=True)
class StartBarrier:
    """Called by the source of `observer` when it is ready: waits, and returns the begin (Unix epoch, ns).

    earliest_ns: the recordings do not begin before.
    """

    folder: Path
    observer: str
    earliest_ns: int = 0
    clock: Callable[[], int] = time.time_ns
    timeout_s: float = BARRIER_TIMEOUT_S

    def __call__(self, stop: threading.Event) -> int:
        """The begin; as soon as possible if the folder is gone or `stop` is set."""
        try:
            begin_ns = self._begin()
            return self._wait(stop) if begin_ns is None else begin_ns
        except (OSError, ValueError) as error:
            log.warning("cannot wait for the other recordings: %s", error)
            return max(self.earliest_ns, self.clock())

    def _wait(self, stop: threading.Event) -> int:
        ready_ns = self.clock()
        self._write(f"{self.observer}.ready", ready_ns)
        while not stop.is_set():
            missing = self._missing()
            late = self.clock() - ready_ns > self.timeout_s * SECOND_NS
            if missing and late:
                others = f"{plural(len(missing), 'observer')}: {', '.join(missing)}"
                log.warning("begins without %s: not ready after %g s", others, self.timeout_s)
            if not missing or late:
                self._agree()
            if (begin_ns := self._begin()) is not None:
                return begin_ns
            stop.wait(BARRIER_CHECK_S)
        return self.clock()

    def _missing(self) -> list[str]:
        return sorted(p.stem for p in self.folder.glob("*.awaited") if not p.with_suffix(".ready").exists())

    def _agree(self) -> None:
        begin_ns = max(self.clock() + round(AHEAD_S * SECOND_NS), self.earliest_ns)
        own = self._write(f"{self.observer}.proposal", begin_ns)
        try:
            os.link(own, self.folder / BEGIN)  # fails if another one was first
        except FileExistsError:
            return

    def _begin(self) -> int | None:
        path = self.folder / BEGIN
        return int(path.read_text()) if path.exists() else None

    def _write(self, name: str, value: int) -> Path:
        """A file that is never seen half written."""
        path, part = self.folder / name, self.folder / f"{name}.part"
        part.write_text(str(value))
        part.replace(path)
        return path
