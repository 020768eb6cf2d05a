"""Health and metrics of a hub over HTTP: what its loop receives and reaches, served on request."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from common.config import Scene
from common.health import ProcessHealth, serve_health
from common.lifecycle import set_log_identity
from hub.session import SceneUpdate

if TYPE_CHECKING:
    from hub.metrics import HubMetrics


class HubInstrumentation:
    """Called by a hub's loop, from any thread. Made by `instrumented`."""

    def __init__(self, health: ProcessHealth, metrics: "HubMetrics | None") -> None:
        self._health, self._metrics = health, metrics

    def record(self, update: SceneUpdate) -> None:
        """Record a message, or a look into the inbox."""
        self._health.record_step(time.monotonic())
        if self._metrics is not None:
            self._metrics.record(update.state, update.message)

    def record_connection(self, peer: str, fault: str = "") -> None:
        """Record whether the hub reaches `peer`, e.g. "the broker"; fault: why not, "" when it does."""
        self._health.set_obstacle(f"{peer}: {fault}" if fault else "")
        if self._metrics is not None:
            self._metrics.record_connection(not fault)


@contextmanager
def instrumented(scenes: Sequence[Scene], hub: str) -> Iterator[HubInstrumentation]:
    """Answer at [metrics] listen of the first scene while the context lasts; hub: `mqtt` or `dashboard`."""
    names = ",".join(scene.scene for scene in scenes)
    set_log_identity(names, "hub", hub)
    health = ProcessHealth(names, "hub", hub, time.monotonic())

    def make() -> "HubMetrics":
        # Imported only where metrics are configured: prometheus_client is slow to load.
        from hub.metrics import HubMetrics

        return HubMetrics(hub)

    with serve_health(scenes[0].metrics.listen, health, make) as metrics:
        yield HubInstrumentation(health, metrics)
