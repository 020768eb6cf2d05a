"""Telling who asks over HTTP how a process of many scenes is: its rounds become vitals and metrics."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from common.config import Scene
from common.health import ProcessHealth, serve_health
from common.lifecycle import set_log_identity

if TYPE_CHECKING:
    from fusion.fleet_metrics import FleetMetrics


@dataclass(frozen=True, slots=True)
class Round:
    """One round of the loop.

    judged: scenes that this process judges. arrived: posteriors. ended: labels of the verdicts on movements that have
    ended. took_s: how long it took.
    """

    judged: int
    arrived: int
    ended: Sequence[str]
    took_s: float


@contextmanager
def telling_rounds(first: Scene, scenes: int) -> Iterator[Callable[[Round], None]]:
    """Answer where the first scene's [metrics] says while the context lasts; gives what wants to know of each round."""
    name, service = f"{scenes} scenes", first.fusion.id
    set_log_identity(name, "fusion", service)
    vitals = ProcessHealth(name, "fusion", service, time.monotonic())

    def make() -> "FleetMetrics":
        # Who is not asked for metrics does not load what they need.
        from fusion.fleet_metrics import FleetMetrics

        return FleetMetrics(service)

    with serve_health(first.metrics.listen, vitals, make) as metrics:

        def tell(taken: Round) -> None:
            vitals.record_step(time.monotonic())
            if metrics is not None:
                metrics.round(taken)

        yield tell
