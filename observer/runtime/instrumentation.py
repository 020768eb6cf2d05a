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
    from observer.runtime.metrics import ObserverMetrics
from common.messages import ProcessState


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
        from observer.runtime.metrics import ObserverMetrics

        return ObserverMetrics(scene.scene, observer, status)

    with serve_health(scene.metrics.listen, vitals, make) as metrics:

        def tell(age_s: float, step_s: float, said: bool) -> None:
            vitals.record_step(time.monotonic())
            if metrics is not None:
                metrics.frame(age_s, step_s, said=said)

        yield tell


Tell = Callable[[ProcessState, str], None]


class HealthReporter:
    """Folds the camera's reports and the tracker's complaints into one state, and tells each change once.

    Starting until the first frame; degraded while the camera is lost or frozen, or else while the tracker complains.
    """

    def __init__(self) -> None:
        self._tell: Tell | None = None
        self._fault, self._complaint, self._started = "", "", False
        self._told: tuple[ProcessState, str] | None = None

    @property
    def complaint(self) -> str:
        """What the tracker complained of last; "" when all is well."""
        return self._complaint

    def tell_to(self, tell: Tell) -> None:
        """From now on each change is told to `tell(state, reason)`, in the thread in which it is heard."""
        self._tell = tell
        self._say()

    def camera(self, state: ProcessState, reason: str) -> None:
        """A `observer.camera.base.Report`: degraded with the reason, or running."""
        self._fault = reason if state == "degraded" else ""
        self._say()

    def frame(self, complaint: str) -> None:
        """A frame was worked on; complaint: why little can be made out in it, "" when all is well."""
        self._started, self._complaint = True, complaint
        self._say()

    def _say(self) -> None:
        reason = self._fault or self._complaint
        if self._tell is None or not (reason or self._started):
            return
        now: tuple[ProcessState, str] = ("degraded" if reason else "running", reason)
        if now != self._told:
            self._told = now
            self._tell(*now)
