"""Whether a process is alive and ready, as /healthz and /readyz answer. Pure: time is passed in.

1. Alive: its loop has taken a step lately. Who is not alive hangs, and only a new process helps.
2. Ready: it does now what it is there for: frames come, the scene is judged, the broker is connected. Who is not ready
   says why, and may become ready by itself.
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
from typing import Protocol, TypeVar

from common.address import Address
from common.messages import ProcessRole

STEPS: dict[ProcessRole, str] = {"observer": "frame", "fusion": "step", "hub": "look"}
"""What a step of the loop is called, by role."""
STALLED_S = 30.0
"""A loop without a step for so long hangs; the container files and systemd's watchdog of fusion wait as long."""
FRESH_S = 2.0
"""A process without a step for so long is not ready; the status message says degraded after as long."""


@dataclass(frozen=True, slots=True)
class HealthResult:
    """Yes or no, and in words why; "" when all is well and there is nothing to add."""

    ok: bool
    reason: str


class ProcessHealth:
    """Written by a process's loop, read by the thread that answers. now_s: seconds, never set back.

    fresh_s: how long ready lasts without a step. note: what the process says of itself, e.g. its status' reason.
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
        self._hindrance = ""

    def record_step(self, now_s: float) -> None:
        """The loop has taken a step: a frame, a judgement, a look into the inbox."""
        self._stepped_s = now_s

    def set_obstacle(self, reason: str) -> None:
        """What keeps it from its work although its loop goes on; "" when nothing does any more."""
        self._hindrance = reason

    def alive(self, now_s: float) -> HealthResult:
        """Whether the loop goes on; a process that has just begun has time until its first step."""
        quiet_s = now_s - (self._began_s if self._stepped_s is None else self._stepped_s)
        return HealthResult(quiet_s < STALLED_S, self._quiet(quiet_s) if quiet_s >= STALLED_S else "")

    def ready(self, now_s: float) -> HealthResult:
        """Whether it does its work now."""
        if self._hindrance:
            return HealthResult(False, self._hindrance)
        note = self._note()
        if self._stepped_s is None:
            return HealthResult(False, note or f"no {STEPS[self.role]} yet")
        quiet_s = now_s - self._stepped_s
        fresh = quiet_s < self._fresh_s
        return HealthResult(fresh, note if fresh else note or self._quiet(quiet_s))

    def _quiet(self, quiet_s: float) -> str:
        return f"no {STEPS[self.role]} for {quiet_s:.0f} s"


LISTEN = "metrics.listen"
PATIENCE_S = 5.0
"""How long a client may take to say what it wants."""
WAKE_S = 0.1
"""How long the server takes to end, at most."""

log = logging.getLogger("labanmesh.common")


class Exposing(Protocol):
    """What knows the text of /metrics."""

    def exposition(self, accept: str) -> tuple[bytes, str]:
        """Text and content type, by the client's Accept header."""


M = TypeVar("M", bound=Exposing)


@contextmanager
def serve_health(listen: str, vitals: ProcessHealth, make: Callable[[], M]) -> Iterator[M | None]:
    """Answer at `listen` (HOST:PORT) while the context lasts; gives what `make` made, None where nobody listens.

    Raises BadInput when `listen` is no HOST:PORT; "" is nowhere.
    """
    if not listen:
        yield None
        return
    metrics = make()
    server = _bound(Address.parse(listen, LISTEN), vitals, metrics)
    if server is None:
        yield None
        return
    with server:
        thread = threading.Thread(target=server.serve_forever, args=(WAKE_S,), name="health", daemon=True)
        thread.start()
        log.info("metrics and health at http://%s", Address(server.address.host, server.server_address[1]))
        try:
            yield metrics
        finally:
            server.shutdown()
            thread.join()


def _bound(address: Address, vitals: ProcessHealth, metrics: Exposing) -> "_Server | None":
    try:
        return _Server(address, vitals, metrics)
    except OSError as error:
        log.warning(
            "%s = '%s': %s; going on without metrics; LABANMESH_METRICS_LISTEN=HOST:PORT is for one process alone",
            *(LISTEN, address, (error.strerror or str(error)).lower()),
        )
        return None


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False

    def __init__(self, address: Address, vitals: ProcessHealth, metrics: Exposing) -> None:
        self.address, self.vitals, self.metrics = address, vitals, metrics
        if ":" in address.host:
            self.address_family = socket.AF_INET6
        super().__init__((address.host, address.port), _Handler)

    def server_bind(self) -> None:
        """Without asking the network's name service what this machine is called, which may take seconds."""
        TCPServer.server_bind(self)

    def handle_error(self, request: object, client_address: object) -> None:
        """A client that went away in the middle is no news."""
        log.debug("%s = '%s': a client went away", LISTEN, self.address, exc_info=True)


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = PATIENCE_S
    protocol_version = "HTTP/1.0"

    def do_GET(self) -> None:
        """One question, one answer."""
        vitals, path = self.server.vitals, self.path.partition("?")[0]
        if path == "/metrics":
            self._send(HTTPStatus.OK, *self.server.metrics.exposition(self.headers.get("Accept", "")))
        elif path == "/healthz":
            self._tell(vitals.alive(time.monotonic()))
        elif path == "/readyz":
            self._tell(vitals.ready(time.monotonic()))
        else:
            self._send(HTTPStatus.NOT_FOUND, b"/metrics, /healthz, /readyz\n", "text/plain; charset=utf-8")

    def do_HEAD(self) -> None:
        """The same without the text."""
        self.do_GET()

    def _tell(self, answer: HealthResult) -> None:
        vitals = self.server.vitals
        said = {"ok": answer.ok, "reason": answer.reason, "scene": vitals.scene, "role": vitals.role,
                "process": vitals.process}  # fmt: skip
        status = HTTPStatus.OK if answer.ok else HTTPStatus.SERVICE_UNAVAILABLE
        self._send(status, json.dumps(said).encode() + b"\n", "application/json")

    def _send(self, status: HTTPStatus, text: bytes, kind: str) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(text)))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(text)

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the base class calls it so
        """A scrape every few seconds is no news."""

    def version_string(self) -> str:
        """No server's name and version for strangers."""
        return "labanmesh"
