"""From messages to the queues of all receivers of a scene."""

import logging
import os
from collections import deque
from collections.abc import Callable
from pathlib import Path

from common import SECOND_NS
from common.backoff import Backoff
from common.config import Scene
from common.errors import BadInput, reason_of
from common.fall_messages import FallMessage
from common.files import read_text
from common.messages import VerdictMessage
from common.text import plural
from hub.database import DatabaseFault
from hub.notify.notification import Notification, notification_of, request_of
from hub.notify.sender import SENDING, NotificationQueue, Receiver, WebhookSender

log = logging.getLogger("labanmesh.hub")
NOTIFICATIONS_LIMIT = 1000
"""Notifications that wait in memory for the queue's file."""
AGAIN_S, BUSY_S = 2.0, 0.5
NEWS_S = 60.0
"""An answer to the query at the start may be long past; up to this age it is told, if it was not."""


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
