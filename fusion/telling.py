"""Telling who asks over HTTP how a fusion service is: its steps become vitals and, where they are wanted, metrics."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from common.config import Scene
from common.health import FRESH_S, ProcessHealth, serve_health
from common.lifecycle import set_log_identity
from common.messages import StatusMessage, VerdictMessage
from fusion.leadership import STEPS_MISSED
from fusion.referee_like import EngineOutputLike

if TYPE_CHECKING:
    from fusion.metrics import FusionMetrics


@dataclass(frozen=True, slots=True)
class Step:
    """One step of the loop: what was judged, whether to speak, which verdicts were said.

    arrived: posteriors in this step; read: those of them that were read, the newest (lot.py). dropped: those left out
    since the start because the inbox was full. took_s: how long it took.
    """

    ruling: EngineOutputLike | None
    leads: bool
    said: Sequence[VerdictMessage]
    arrived: int
    read: int
    dropped: int
    took_s: float


@contextmanager
def telling(
    scene: Scene, labels: Sequence[str], status: Callable[[], StatusMessage]
) -> Iterator[Callable[[Step], None]]:
    """Answer where [metrics] says while the context lasts; gives what wants to know of each step."""
    vitals = _vitals(scene, lambda: status().reason)

    def make() -> "FusionMetrics":
        # Who is not asked for metrics does not load what they need.
        from fusion.metrics import FusionMetrics

        return FusionMetrics(scene.scene, scene.fusion.id, labels, status)

    with serve_health(scene.metrics.listen, vitals, make) as metrics:

        def tell(step: Step) -> None:
            vitals.record_step(time.monotonic())
            if metrics is not None:
                metrics.step(step)

        yield tell


@contextmanager
def waiting(scene: Scene, reason: str) -> Iterator[Callable[[], None]]:
    """The same before the loop begins: alive, and not ready for `reason`; gives what wants to know of each try."""
    vitals = _vitals(scene, str)
    vitals.set_obstacle(reason)

    def make() -> "FusionMetrics":
        from fusion.metrics import FusionMetrics

        return FusionMetrics(scene.scene, scene.fusion.id, (), None)

    with serve_health(scene.metrics.listen, vitals, make):
        yield lambda: vitals.record_step(time.monotonic())


def _vitals(scene: Scene, note: Callable[[], str]) -> ProcessHealth:
    set_log_identity(scene.scene, "fusion", scene.fusion.id)
    # Who has missed so many steps, and for FRESH_S at least, is not ready any more.
    fresh_s = max(FRESH_S, STEPS_MISSED / scene.fusion.step_hz)
    return ProcessHealth(scene.scene, "fusion", scene.fusion.id, time.monotonic(), fresh_s, note)
