"""Health and metrics of a fusion service over HTTP."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from common.health import FRESH_S, ProcessHealth, serve_health
from common.lifecycle import set_log_identity
from common.messages import VerdictMessage
from common.text import plural
from fusion.membership import ASKING, STEPS_MISSED, SceneMember

if TYPE_CHECKING:
    from fusion.metrics import FusionMetrics


@dataclass(frozen=True, slots=True)
class ServerStep:
    """One step of the loop.

    published: the verdicts. owned: scenes that this service owns. received, read: posteriors that arrived
    in this step, and those that were decoded. dropped: posteriors left out since the start. took_s: its duration.
    """

    published: Sequence[VerdictMessage]
    owned: int
    received: int
    read: int
    dropped: int
    took_s: float


@contextmanager
def instrumented(members: Sequence[SceneMember], own: str) -> Iterator[Callable[[ServerStep], None]]:
    """Serve health and metrics of the fusion service `own` while the context lasts; yields the recorder of its steps.

    The address is `metrics.listen` of the first of the scenes. Without it nothing is served, and the recorder works.
    """
    first = members[0]
    only = first if len(members) == 1 else None
    name = first.scene.scene if only else plural(len(members), "scene")
    set_log_identity(name, "fusion", own)
    # A service that has missed several steps, and for FRESH_S at least, is not ready any more.
    fresh_s = max(FRESH_S, STEPS_MISSED / first.scene.fusion.step_hz)

    def reason() -> str:
        return only.status.status(time.time_ns()).reason if only else ""

    def obstacle() -> str:
        return ASKING if only and only.vocabulary is None else ""

    health = ProcessHealth(name, "fusion", own, time.monotonic(), fresh_s, reason)
    health.set_obstacle(obstacle())

    def make() -> "FusionMetrics":
        # prometheus_client is loaded only where metrics are served.
        from fusion.metrics import FusionMetrics

        return FusionMetrics(own, only)

    with serve_health(first.scene.metrics.listen, health, make) as metrics:

        def record(step: ServerStep) -> None:
            health.record_step(time.monotonic())
            health.set_obstacle(obstacle())
            if metrics is not None:
                metrics.record(step)

        yield record
