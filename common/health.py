"""Health of a process, which health_server.py serves as /metrics, /healthz and /readyz.

1. Alive: the loop has taken a step recently. A process that is not alive hangs, and must be restarted.
2. Ready: the process does its work: frames arrive, the scene is judged, the broker is connected. A process that is not
   ready reports why, and can become ready by itself.
3. The server has threads of its own. The loop never waits for it; an address that cannot be used is one warning in the
   log, and the process goes on without the server.
"""

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

from common.address import Address
from common.messages import ProcessRole

if TYPE_CHECKING:
    from common.metrics import Metrics

METRICS_LISTEN = "metrics.listen"
STEPS: dict[ProcessRole, str] = {"observer": "frame", "fusion": "step", "hub": "look"}
"""The word for a step of the loop, by role."""
STALLED_S = 30.0
"""A loop without a step for this long hangs; the container files and systemd's watchdog wait as long."""
FRESH_S = 2.0
"""A process without a step for this long is not ready; its status message says degraded after the same time."""
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
        """Note that the loop has taken a step: a frame, a judgement, a look into the inbox."""
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
    # Python's HTTP server is loaded only where it is used.
    from common.health_server import bind

    metrics = make()
    server = bind(Address.parse(listen, METRICS_LISTEN), health, metrics)
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
