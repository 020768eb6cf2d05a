"""Telling who asks over HTTP how an observer is: its frames become vitals and, where they are wanted, metrics."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from common.config import Scene
from common.health import ProcessHealth, serve_health
from common.lifecycle import set_log_identity
from common.messages import StatusMessage

if TYPE_CHECKING:
    from observer.metrics import ObserverMetrics


@contextmanager
def telling(
    scene: Scene, observer: str, status: Callable[[], StatusMessage]
) -> Iterator[Callable[[float, float, bool], None]]:
    """Answer where [metrics] says while the context lasts; gives what wants to know of each frame.

    Of a frame: how old it was when it had been judged, how long that took, seconds, and whether a posterior came of it.
    """
    set_log_identity(scene.scene, "observer", observer)
    vitals = ProcessHealth(scene.scene, "observer", observer, time.monotonic(), note=lambda: status().reason)

    def make() -> "ObserverMetrics":
        # Who is not asked for metrics does not load what they need.
        from observer.metrics import ObserverMetrics

        return ObserverMetrics(scene.scene, observer, status)

    with serve_health(scene.metrics.listen, vitals, make) as metrics:

        def tell(age_s: float, step_s: float, said: bool) -> None:
            vitals.record_step(time.monotonic())
            if metrics is not None:
                metrics.frame(age_s, step_s, said=said)

        yield tell
