"""The process behind `labanmesh hub events`: keeps what happens in a scene, and tells others of it.

Recognition and hubs never wait for the history file, whatever happens to it:

1. What cannot be written waits, up to WAITING_LIMIT rows, and is written when the file can be used again.
2. A fault is logged once, when it begins, and once when it is over, with how much was lost meanwhile.
3. A damaged file is moved aside, and a new one is begun.
"""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path

from common import MINUTE_NS, SECOND_NS
from common.backoff import Backoff
from common.config import Scene
from common.config_hub import HistoryConfig
from common.errors import BadInput
from common.fall_messages import FallMessage
from common.link import Link
from common.messages import VerdictMessage
from common.notify import Notifier
from common.text import plural
from hub.database import DatabaseFault
from hub.history.history_file import HistoryFile
from hub.history.records import HistoryRow, row_of
from hub.instrumentation import instrumented
from hub.notify.notifying import Notifying
from hub.notify.sender import SENDING
from hub.session import listen

log = logging.getLogger("labanmesh.hub")
WAITING_LIMIT = 10_000
"""Rows that wait for the file, about 5 MB."""
AGAIN_S, OLD_EVERY_S = 2.0, 600.0
"""After a fault the file is tried again so soon; what is old is deleted so often."""
KEEPER_BUSY_S = 0.5


class HistoryKeeper:
    """Writes rows to the file at `path`; ticks: monotonic seconds; clock: Unix epoch in ns."""

    def __init__(self, path: Path, config: HistoryConfig, ticks: Callable[[], float], clock: Callable[[], int]) -> None:
        self._path, self._config, self._ticks, self._clock = path, config, ticks, clock
        self._waiting: deque[HistoryRow] = deque(maxlen=WAITING_LIMIT)
        self._file: HistoryFile | None = None
        self._again_s = self._old_s = float("-inf")
        self._newest_ns = 0
        self.fault, self.lost = "", 0

    def add(self, row: HistoryRow) -> None:
        """Keep a row, now or as soon as the file can be used."""
        if len(self._waiting) == WAITING_LIMIT:
            self.lost += 1
        self._waiting.append(row)
        self._note_clock(row)
        self.work()

    def work(self) -> None:
        """Write what waits, and delete what is old, if it is due."""
        now_s = self._ticks()
        if now_s < self._again_s:
            return
        try:
            file = self._opened()
            if self._waiting:
                file.add(*self._waiting)
                self._waiting.clear()
            if now_s - self._old_s >= OLD_EVERY_S:
                self._old_s = now_s
                file.delete_old(self._clock(), self._config.keep_days, self._config.keep_mb)
        except DatabaseFault as error:
            self._again_s = now_s + AGAIN_S
            if str(error) != self.fault:
                self.fault = str(error)
                log.warning("history: %s; what happens waits in memory, up to %d events", error, WAITING_LIMIT)
            self.close()
            if error.is_damaged:
                self._set_aside()
            return
        if self.fault:
            lost = f"; {plural(self.lost, 'event')} lost meanwhile" if self.lost else ""
            log.warning("history: %s can be written again%s", self._path, lost)
            self.fault, self.lost = "", 0

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _opened(self) -> HistoryFile:
        if self._file is None:
            self._file = HistoryFile.to_write(self._path, KEEPER_BUSY_S)
        return self._file

    def _set_aside(self) -> None:
        aside = self._path.with_name(f"{self._path.name}.damaged-{self._clock() // SECOND_NS}")
        for suffix in ("", "-wal", "-shm"):
            old = self._path.with_name(self._path.name + suffix)
            if old.exists():
                old.rename(aside.with_name(aside.name + suffix))
        log.warning("history: the damaged file is now %s, and a new one is begun", aside)
        self._again_s = float("-inf")

    def _note_clock(self, row: HistoryRow) -> None:
        if row.at_ns < self._newest_ns - MINUTE_NS:
            back_s = (self._newest_ns - row.at_ns) / SECOND_NS
            log.warning("history: the fusion machine's clock was set back by %.0f s; times repeat", back_s)
            self._newest_ns = row.at_ns
        self._newest_ns = max(self._newest_ns, row.at_ns)


NOTHING_TO_DO = (
    'nothing to do: the scene file has neither [history] with file = "history.db" nor [notify.NAME] '
    "(docs/guide/history.md, docs/guide/notify.md)"
)


def serve(
    scene: Scene,
    link: Link,
    stop: threading.Event,
    clock: Callable[[], int] = time.time_ns,
    backoff: Backoff = SENDING,
) -> None:
    """Keep and tell until `stop` is set. Raises BadInput for a scene that asks for neither, and for its secrets."""
    require_something(scene)
    path = scene.place(scene.history.file) if scene.history.file else None
    keeper = HistoryKeeper(path, scene.history, time.monotonic, clock) if path else None
    notifying = Notifying(scene, time.monotonic, clock, backoff)
    supervisor = Notifier.from_environment()
    kept = f"history in {path}" if path else "no history"
    log.info("%s: %s; tells %s", scene.scene, kept, ", ".join(scene.notify) or "nobody")
    try:
        with supervisor, instrumented([scene], "events") as instrumentation:
            for update in listen(scene, link, lambda: not stop.is_set(), clock, newest_only=True):
                instrumentation.record(update)
                message = update.message
                if isinstance(message, VerdictMessage | FallMessage):
                    row = row_of(message)
                    if keeper is not None and row is not None:
                        keeper.add(row)
                    notifying.take(message, update.answered)
                if keeper is not None:
                    keeper.work()
                notifying.work()
                supervisor.alive()
    finally:
        notifying.close()
        if keeper is not None:
            keeper.close()


def require_something(scene: Scene) -> None:
    """Raises BadInput for a scene that keeps no history and tells nobody."""
    if not (scene.history.file or scene.notify):
        raise BadInput(f"scene {scene.scene}: {NOTHING_TO_DO}")
