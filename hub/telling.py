"""Telling who asks over HTTP how a hub is: what it hears and reaches becomes vitals and, where wanted, metrics."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from common.config import Scene
from common.health import ProcessHealth, serve_health
from common.lifecycle import set_log_identity
from hub.session import Heard

if TYPE_CHECKING:
    from hub.metrics import HubMetrics


class Teller:
    """What a hub's loop calls; from any thread. Made by `telling`."""

    def __init__(self, vitals: ProcessHealth, metrics: "HubMetrics | None") -> None:
        self._vitals, self._metrics = vitals, metrics

    def heard(self, heard: Heard) -> None:
        """A message, or a look into the inbox."""
        self._vitals.record_step(time.monotonic())
        if self._metrics is not None:
            self._metrics.heard(heard.state, heard.message)

    def reaches(self, what: str, reason: str = "") -> None:
        """The hub reaches `what` it hands on to, e.g. "the broker"; reason: why it does not, "" when it does."""
        self._vitals.set_obstacle(f"{what}: {reason}" if reason else "")
        if self._metrics is not None:
            self._metrics.connected(not reason)


@contextmanager
def telling(scenes: Sequence[Scene], hub: str) -> Iterator[Teller]:
    """Answer where [metrics] of the first scene says while the context lasts; hub: `mqtt` or `dashboard`."""
    names = ",".join(scene.scene for scene in scenes)
    set_log_identity(names, "hub", hub)
    vitals = ProcessHealth(names, "hub", hub, time.monotonic())

    def make() -> "HubMetrics":
        # Who is not asked for metrics does not load what they need.
        from hub.metrics import HubMetrics

        return HubMetrics(hub)

    with serve_health(scenes[0].metrics.listen, vitals, make) as metrics:
        yield Teller(vitals, metrics)
