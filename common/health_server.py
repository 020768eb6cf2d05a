"""The small HTTP server of a process for /metrics, /healthz and /readyz."""

import json
import logging
import socket
import threading
import time
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from socketserver import TCPServer
from typing import TYPE_CHECKING

from common.address import Address
from common.errors import reason_of
from common.health import METRICS_LISTEN, HealthResult, ProcessHealth

if TYPE_CHECKING:
    from common.metrics import Metrics

REQUEST_TIMEOUT_S = 5.0
"""How long a client may take to send its request."""
REQUESTS_LIMIT = 32
"""Requests that are answered at the same time, each in a thread of its own; of more the connection is closed."""
BACK_OFF_S = 0.2
"""Pause after a connection that could not be accepted, as without descriptors; else the server would spin."""

log = logging.getLogger("labanmesh.common")


def bind(address: Address, health: ProcessHealth, metrics: "Metrics") -> "HealthServer | None":
    """The server at `address`; None, with one warning in the log, if the address cannot be used."""
    try:
        return HealthServer(address, health, metrics)
    except OSError as error:
        log.warning(
            "%s = '%s': %s; going on without metrics; set LABANMESH_METRICS_LISTEN=HOST:PORT for one process alone",
            *(METRICS_LISTEN, address, reason_of(error)),
        )
        return None


class HealthServer(ThreadingHTTPServer):
    """Answers each request in a thread of its own."""

    daemon_threads = True
    block_on_close = False
    request_queue_size = 64

    def __init__(self, address: Address, health: ProcessHealth, metrics: "Metrics") -> None:
        self.address, self.health, self.metrics = address, health, metrics
        if ":" in address.host:
            self.address_family = socket.AF_INET6
        self._free = threading.BoundedSemaphore(REQUESTS_LIMIT)
        super().__init__((address.host, address.port), _Handler)

    def get_request(self) -> tuple[socket.socket, object]:
        """Accept a connection; raises OSError, which the caller ignores."""
        try:
            return super().get_request()
        except OSError as error:
            log.warning("%s = '%s': cannot accept a connection: %s", METRICS_LISTEN, self.address, reason_of(error))
            time.sleep(BACK_OFF_S)
            raise

    def process_request(self, request: object, client_address: object) -> None:
        """Answer in a thread, if one is free."""
        if not self._free.acquire(blocking=False):
            self.shutdown_request(request)  # type: ignore[arg-type]
            return
        try:
            super().process_request(request, client_address)  # type: ignore[arg-type]
        except RuntimeError:
            # No thread could be started.
            self._free.release()
            raise

    def process_request_thread(self, request: object, client_address: object) -> None:
        """Answer one request."""
        try:
            super().process_request_thread(request, client_address)  # type: ignore[arg-type]
        finally:
            self._free.release()

    def server_bind(self) -> None:
        """Bind without a query to the name service for this machine's name, which may take seconds."""
        TCPServer.server_bind(self)

    def handle_error(self, request: object, client_address: object) -> None:
        """Log at debug level what failed in answering a client, which usually has closed its connection."""
        log.debug("%s = '%s': a client closed its connection", METRICS_LISTEN, self.address, exc_info=True)


class _Handler(BaseHTTPRequestHandler):
    server: HealthServer
    timeout = REQUEST_TIMEOUT_S
    protocol_version = "HTTP/1.0"

    def do_GET(self) -> None:
        """Answer one request."""
        health, path = self.server.health, self.path.partition("?")[0]
        if path == "/metrics":
            self._send(HTTPStatus.OK, *self.server.metrics.exposition(self.headers.get("Accept", "")))
        elif path == "/healthz":
            self._send_result(health.alive(time.monotonic()))
        elif path == "/readyz":
            self._send_result(health.ready(time.monotonic()))
        else:
            self._send(HTTPStatus.NOT_FOUND, b"/metrics, /healthz, /readyz\n", "text/plain; charset=utf-8")

    def do_HEAD(self) -> None:
        """Same as GET, without the body."""
        self.do_GET()

    def _send_result(self, result: HealthResult) -> None:
        health = self.server.health
        body = {"ok": result.ok, "reason": result.reason, "scene": health.scene, "role": health.role}
        status = HTTPStatus.OK if result.ok else HTTPStatus.SERVICE_UNAVAILABLE
        text = json.dumps({**body, "process": health.process}).encode() + b"\n"
        self._send(status, text, "application/json")

    def _send(self, status: HTTPStatus, text: bytes, kind: str) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(text)))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(text)

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the base class calls it so
        """Log nothing: there is a request every few seconds."""

    def version_string(self) -> str:
        """Do not tell strangers the server's name and version."""
        return "labanmesh"
