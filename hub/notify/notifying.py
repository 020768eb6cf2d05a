"""From messages to the queues of all receivers of a scene; and the verb `labanmesh notify`."""

import logging
import os
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from common import SECOND_NS
from common.backoff import Backoff
from common.config import Scene, read_scene
from common.errors import BadInput, LabanmeshError, reason_of
from common.fall_messages import FallMessage
from common.files import read_text
from common.messages import VerdictMessage
from common.text import plural
from hub.database import DatabaseFault
from hub.notify.notification import Notification, notification_of, request_of, test_notification
from hub.notify.sender import SENDING, NotificationQueue, Receiver, WebhookSender

log = logging.getLogger("labanmesh.hub")
NOTIFICATIONS_LIMIT = 1000
"""Notifications that wait in memory for the queue's file."""
AGAIN_S, BUSY_S = 2.0, 0.5
NEWS_S = 60.0
"""An answer to the query at the start may be long past; up to this age it is told, if it was not."""
NO_RECEIVERS = "in the scene file: [notify.phone] with url and preset (docs/guide/notify.md)"


def receivers_of(scene: Scene) -> list[Receiver]:
    """All receivers with their secrets; raises BadInput for a file that cannot be read."""
    return [
        Receiver(
            name, config, config.url or _secret(scene, name, "url_file", config.url_file),
            _secret(scene, name, "token_file", config.token_file),
            _secret(scene, name, "secret_file", config.secret_file),
        )
        for name, config in scene.notify.items()
    ]  # fmt: skip


def queue_path(scene: Scene) -> Path:
    """The file of the queues: in $STATE_DIRECTORY, else beside the scene file."""
    folder = os.environ.get("STATE_DIRECTORY")
    return (Path(folder.partition(":")[0]) if folder else scene.place(".")) / f"{scene.scene}.notify.db"


def _secret(scene: Scene, name: str, key: str, file: str) -> str:
    if not file:
        return ""
    path = scene.place(file)
    try:
        text = read_text(path).strip()
    except OSError as error:
        raise BadInput(f"notify.{name}.{key}: {path}: {reason_of(error)}") from None
    except ValueError as error:
        raise BadInput(f"notify.{name}.{key}: {path}: {error}") from None
    if not text or len(text.split()) != 1:
        raise BadInput(f"notify.{name}.{key}: {path}: one word is expected")
    return text


class Notifying:
    """The queue and the senders; ticks: monotonic seconds, clock: Unix epoch in ns."""

    def __init__(
        self, scene: Scene, ticks: Callable[[], float], clock: Callable[[], int], backoff: Backoff = SENDING
    ) -> None:
        self._receivers, self._path = receivers_of(scene), queue_path(scene)
        self._ticks, self._clock, self._backoff = ticks, clock, backoff
        self._queue: NotificationQueue | None = None
        self._senders: dict[str, WebhookSender] = {}
        self._waiting: deque[tuple[Receiver, Notification]] = deque(maxlen=NOTIFICATIONS_LIMIT)
        self._again_s, self._fault = float("-inf"), ""

    def take(self, message: VerdictMessage | FallMessage, answered: bool) -> None:
        """Put what is to be told of a message into the queues."""
        if answered and not 0 <= self._clock() - message.at_ns < NEWS_S * SECOND_NS:
            return
        for receiver in self._receivers:
            note = notification_of(message, receiver.config)
            if note is not None:
                self._waiting.append((receiver, note))
        self.work()

    def work(self) -> None:
        """Write what waits into the queues, and wake the senders."""
        if self._ticks() < self._again_s or not self._receivers:
            return
        try:
            queue = self._opened()
            while self._waiting:
                receiver, note = self._waiting[0]
                request = request_of(note, receiver.config, receiver.token)
                dropped = queue.put(receiver.name, note, request, receiver.config, self._clock())
                self._waiting.popleft()
                self._senders[receiver.name].wake()
                if dropped:
                    log.warning("notify.%s: the queue is full: the oldest was dropped", receiver.name)
        except DatabaseFault as error:
            self._again_s = self._ticks() + AGAIN_S
            if str(error) != self._fault:
                self._fault = str(error)
                log.warning("notify: %s; %s in memory", error, plural(len(self._waiting), "notification"))
            return
        self._fault = ""

    def close(self) -> None:
        """End the senders; what waits in the queues is sent after the next start."""
        for sender in self._senders.values():
            sender.close()
        if self._queue is not None:
            self._queue.close()

    def _opened(self) -> NotificationQueue:
        if self._queue is None:
            self._queue = NotificationQueue(self._path, BUSY_S)
            self._senders = {
                receiver.name: WebhookSender(receiver, self._queue, self._backoff, self._clock)
                for receiver in self._receivers
            }
        return self._queue


def notify(
    scene: Annotated[Path, typer.Argument(help="The scene file; its [notify.NAME] name the receivers.")],
    name: Annotated[str, typer.Argument(help="Only this receiver.")] = "",
    test: Annotated[bool, typer.Option("--test", help="Send a test to each of them now.")] = False,
) -> None:
    """List whom the scene tells of movements and falls, and how many notifications wait for each; or send a test.

    `labanmesh hub events SCENE` sends them.

    Example: labanmesh notify scene.toml --test
    """
    config = read_scene(scene)
    receivers = [each for each in receivers_of(config) if name in ("", each.name)]
    if not receivers:
        known = ", ".join(config.notify)
        raise BadInput(f"no receiver {name!r}; known: {known}" if known else f"the scene tells nobody; {NO_RECEIVERS}")
    failed = []
    path = queue_path(config)
    for receiver in receivers:
        if test:
            note = test_notification(config.scene, time.time_ns())
            result = receiver.send(request_of(note, receiver.config, receiver.token))
            print(f"{receiver.name}: {result.fault or 'accepted'}", flush=True)
            failed += [receiver.name] if result.fault else []
            continue
        waiting = 0
        if path.exists():
            queue = NotificationQueue(path)
            waiting = queue.count(receiver.name)
            queue.close()
        print(f"{receiver.name}: {receiver.config.preset}, {waiting} waiting")
    if failed:
        raise LabanmeshError(f"{', '.join(failed)}: the lines above say why")
