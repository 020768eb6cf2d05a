"""Health of a process, and the small HTTP server for /metrics, /healthz and /readyz.

1. Alive: the loop has taken a step recently. A process that is not alive hangs, and must be restarted.
2. Ready: the process does its work: frames arrive, the scene is judged, the broker is connected. A process that is not
   ready reports why, and can become ready by itself.
3. The server has threads of its own. The loop never waits for it; an address that cannot be used is one warning in the
   log, and the process goes on without the server.
"""

import json
import logging
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from socketserver import TCPServer
from typing import TYPE_CHECKING, TypeVar

from common.address import Address
from common.errors import reason_of
from common.messages import ProcessRole

if TYPE_CHECKING:
    from common.metrics import Metrics

LISTEN = "metrics.listen"
STEPS: dict[ProcessRole, str] = {"observer": "frame", "fusion": "step", "hub": "look"}
"""The word for a step of the loop, by role."""
STALLED_S = 30.0
"""A loop without a step for this long hangs; the container files and systemd's watchdog wait as long."""
FRESH_S = 2.0
"""A process without a step for this long is not ready; its status message says degraded after the same time."""
REQUEST_TIMEOUT_S = 5.0
"""How long a client may take to send its request."""
REQUESTS_LIMIT = 32
"""Requests that are answered at the same time, each in a thread of its own; of more the connection is closed."""
BACK_OFF_S = 0.2
"""Pause after a connection that could not be accepted, as without descriptors; else the server would spin."""
SHUTDOWN_POLL_S = 0.1
"""The server ends within this time."""

log = logging.getLogger("labanmesh.common")
M = TypeVar("M", bound="Metrics")


@dataclass(frozen=True, slots=True)
class HealthResult:
    """Yes or no, and the reason; "" if all is well and there is nothing to add."""

    ok: bool
    reason: str


class ProcessHealth:
    """Written by a process's loop, read by the server's threads. now_s: seconds of a monotonic clock.

    fresh_s: how long a process is ready without a step. note: text that the process adds, e.g. its status's reason.
    """

    def __init__(
        self,
        scene: str,
        role: ProcessRole,
        process: str,
        now_s: float,
        fresh_s: float = FRESH_S,
        note: Callable[[], str] = str,
    ) -> None:
        self.scene, self.role, self.process = scene, role, process
        self._fresh_s, self._note = fresh_s, note
        self._began_s = now_s
        self._stepped_s: float | None = None
        self._obstacle = ""

    def record_step(self, now_s: float) -> None:
        """The loop has taken a step: a frame, a judgement, a look into the inbox."""
        self._stepped_s = now_s

    def set_obstacle(self, reason: str) -> None:
        """Set what prevents the process from its work although its loop goes on; "" if nothing does."""
        self._obstacle = reason

    def alive(self, now_s: float) -> HealthResult:
        """Whether the loop goes on; a process that has just started has time until its first step."""
        quiet_s = now_s - (self._began_s if self._stepped_s is None else self._stepped_s)
        return HealthResult(quiet_s < STALLED_S, self._quiet(quiet_s) if quiet_s >= STALLED_S else "")

    def ready(self, now_s: float) -> HealthResult:
        """Whether the process does its work now."""
        if self._obstacle:
            return HealthResult(False, self._obstacle)
        note = self._note()
        if self._stepped_s is None:
            return HealthResult(False, note or f"no {STEPS[self.role]} yet")
        quiet_s = now_s - self._stepped_s
        fresh = quiet_s < self._fresh_s
        return HealthResult(fresh, note if fresh else note or self._quiet(quiet_s))

    def _quiet(self, quiet_s: float) -> str:
        return f"no {STEPS[self.role]} for {quiet_s:.0f} s"


@contextmanager
def serve_health(listen: str, health: ProcessHealth, make: Callable[[], M]) -> Iterator[M | None]:
    """Serve at `listen` (HOST:PORT) in a context; gives the metrics that `make` returns, or None without a server.

    Raises BadInput if `listen` is not HOST:PORT; "" means no server.
    """
    if not listen:
        yield None
        return
    metrics = make()
    server = _bind(Address.parse(listen, LISTEN), health, metrics)
    if server is None:
        yield None
        return
    with server:
        thread = threading.Thread(target=server.serve_forever, args=(SHUTDOWN_POLL_S,), name="health", daemon=True)
        thread.start()
        log.info("metrics and health at http://%s", Address(server.address.host, server.server_address[1]))
        try:
            yield metrics
        finally:
            server.shutdown()
            thread.join()


def _bind(address: Address, health: ProcessHealth, metrics: "Metrics") -> "_Server | None":
    try:
        return _Server(address, health, metrics)
    except OSError as error:
        log.warning(
            "%s = '%s': %s; going on without metrics; set LABANMESH_METRICS_LISTEN=HOST:PORT for one process alone",
            *(LISTEN, address, reason_of(error)),
        )
        return None


class _Server(ThreadingHTTPServer):
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
            log.warning("%s = '%s': cannot accept a connection: %s", LISTEN, self.address, reason_of(error))
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
        """Log a client that closed its connection early at debug level."""
        log.debug("%s = '%s': a client closed its connection", LISTEN, self.address, exc_info=True)


class _Handler(BaseHTTPRequestHandler):
    server: _Server
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
