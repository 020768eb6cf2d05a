"""One POST to a webhook: within a time limit, without redirects, and whatever the answer is, little of it is read."""

import http.client
import socket
import ssl
import threading
from dataclasses import dataclass
from urllib.parse import urlsplit

from common.message_types import printable
from hub.notify.notification import WebhookRequest

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
