"""The process behind `labanmesh hub events`: keeps what happens in a scene, and tells others of it."""

import logging
import threading
import time
from collections.abc import Callable

from common.backoff import Backoff
from common.config import Scene
from common.errors import BadInput
from common.fall_messages import FallMessage
from common.link import Link
from common.messages import VerdictMessage
from common.notify import Notifier
from hub.history.keeper import HistoryKeeper
from hub.history.records import row_of
from hub.instrumentation import instrumented
from hub.notify.notifying import Notifying
from hub.notify.sender import SENDING
from hub.session import listen

log = logging.getLogger("labanmesh.hub")
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
