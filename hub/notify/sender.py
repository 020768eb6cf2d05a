"""Sends what waits for one receiver, in order, in a thread of its own: nothing else waits for the receiver.

A POST ends within a time limit, follows no redirects, and reads little of the answer, whatever it is.
"""

import http.client
import logging
import socket
import ssl
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from urllib.parse import urlsplit

from common import SECOND_NS
from common.backoff import Backoff
from common.config_events import NotifyConfig
from common.message_types import printable
from common.text import plural
from hub.database import DatabaseFault
from hub.notify.notification import WebhookRequest, signed
from hub.notify.notification_queue import NotificationQueue, Waiting

log = logging.getLogger("labanmesh.hub")
HOUR_NS = 3600 * SECOND_NS
IDLE_S = 1.0
SENDING = Backoff(1.0, 300.0)
ANSWER_CHARACTERS = 120
"""Bytes of an error's answer that are shown."""
LATER = frozenset({401, 403, 404, 405, 408, 425, 429})
"""Refusals that somebody or time may mend: the request waits. After any other of 400 to 499 it is never accepted."""


@dataclass(frozen=True, slots=True)
class WebhookResult:
    """fault: why it was not accepted, one line; "": it was. is_final: it never will be."""

    fault: str = ""
    is_final: bool = False


def post(url: str, request: WebhookRequest, timeout_s: float) -> WebhookResult:
    """Send one request; returns within about `timeout_s`."""
    parts = urlsplit(url)
    host, path = parts.hostname or "", (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
    secure = parts.scheme == "https"
    kind = http.client.HTTPSConnection if secure else http.client.HTTPConnection
    connection = kind(host, parts.port, timeout=timeout_s)
    over = threading.Event()

    def give_up() -> None:
        """A server that sends a byte now and then would hold a plain time limit off for ever."""
        over.set()
        if connection.sock is not None:
            try:
                connection.sock.shutdown(socket.SHUT_RDWR)
            except OSError:
                return

    timer = threading.Timer(timeout_s, give_up)
    timer.daemon = True
    timer.start()
    try:
        connection.request("POST", path, request.body, dict(request.headers))
        result = _result(connection.getresponse())
        # A server that never ends its headers has not answered.
        return WebhookResult(f"no answer within {timeout_s:g} s") if over.is_set() else result
    except (OSError, http.client.HTTPException, ssl.SSLError, ValueError) as error:
        if over.is_set() or isinstance(error, TimeoutError):
            return WebhookResult(f"no answer within {timeout_s:g} s")
        return WebhookResult(_reason(error))
    finally:
        timer.cancel()
        connection.close()


def _result(response: http.client.HTTPResponse) -> WebhookResult:
    status = response.status
    if 200 <= status < 300:
        return WebhookResult()
    if 300 <= status < 400:
        where = printable(response.getheader("Location") or "elsewhere")[:ANSWER_CHARACTERS]
        return WebhookResult(f"redirects to {where}; write that address, if it is the right one")
    text = " ".join(response.read(ANSWER_CHARACTERS).decode("utf-8", "replace").split())
    words = printable(f"answers {status} {response.reason}" + (f": {text}" if text else ""))
    return WebhookResult(words, is_final=400 <= status < 500 and status not in LATER)


def _reason(error: Exception) -> str:
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"its certificate is not accepted: {error.verify_message}"
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return printable(text.lower())[:ANSWER_CHARACTERS]


@dataclass(frozen=True, slots=True)
class Receiver:
    """A [notify.NAME] of the scene file, with its secrets."""

    name: str
    config: NotifyConfig
    url: str
    token: str = ""
    secret: str = ""

    def send(self, request: WebhookRequest) -> WebhookResult:
        """Send one request now."""
        return post(self.url, signed(request, self.secret, int(time.time())), self.config.timeout_s)


class WebhookSender:
    """The thread; clock: Unix epoch in ns."""

    def __init__(
        self,
        receiver: Receiver,
        queue: NotificationQueue,
        backoff: Backoff = SENDING,
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        self._receiver, self._queue, self._clock = receiver, queue, clock
        self._backoff = backoff
        self._wake, self._ended = threading.Event(), threading.Event()
        self._failures, self._fault = 0, ""
        self._thread = threading.Thread(target=self._run, name=f"notify-{receiver.name}", daemon=True)
        self._thread.start()

    def wake(self) -> None:
        """Send at once: a new notification waits in the queue."""
        self._wake.set()

    def close(self) -> None:
        """End after the request that is being sent; what waits stays in the queue."""
        self._ended.set()
        self._wake.set()
        self._thread.join(self._receiver.config.timeout_s + 1.0)

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                waiting = self._queue.oldest(self._receiver.name)
                pause_s = IDLE_S if waiting is None else self._send(waiting)
            except DatabaseFault as error:
                pause_s = self._failed(str(error))
            if self._failures:
                # Not woken by what is new: it comes after what could not be sent.
                self._ended.wait(pause_s)
            elif pause_s:
                self._wake.wait(pause_s)
                self._wake.clear()

    def _send(self, waiting: Waiting) -> float:
        if self._clock() - waiting.since_ns > self._receiver.config.keep_hours * HOUR_NS:
            self._queue.remove(waiting.seq)
            log.warning("notify.%s: given up after %g h: %s", self._receiver.name, self._receiver.config.keep_hours,
                        waiting.request.headers.get("X-Labanmesh-Id", ""))  # fmt: skip
            return 0.0
        result = self._receiver.send(waiting.request)
        if result.fault and not result.is_final:
            return self._failed(result.fault)
        self._queue.remove(waiting.seq)
        if result.fault:
            log.warning("notify.%s: refused for good: %s", self._receiver.name, result.fault)
        elif self._failures:
            log.warning("notify.%s: works again after %s", self._receiver.name, plural(self._failures, "failure"))
        self._failures, self._fault = 0, ""
        return 0.0

    def _failed(self, fault: str) -> float:
        self._failures += 1
        if fault != self._fault:
            self._fault = fault
            log.warning("notify.%s: %s; it is tried again, and what is due waits", self._receiver.name, fault)
        return self._backoff.wait_s(self._failures)
