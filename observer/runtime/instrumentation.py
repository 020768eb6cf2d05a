"""What an observer reports about itself: its health over HTTP, its metrics, and its state from camera and tracker."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from common.config import Scene
from common.health import ProcessHealth, serve_health
from common.lifecycle import set_log_identity
from common.messages import ProcessState, StatusMessage

if TYPE_CHECKING:
    from observer.runtime.metrics import ObserverMetrics

ReportState = Callable[[ProcessState, str], None]
RecordFrame = Callable[[float, float, bool], None]
"""Called for each frame with its age at the end of the step and the step's duration, in seconds, and whether a
posterior was sent."""


@contextmanager
def instrument(scene: Scene, observer: str, status: Callable[[], StatusMessage]) -> Iterator[RecordFrame]:
    """Serve health and metrics at the scene's [metrics] address while the context lasts; yields the frame recorder."""
    set_log_identity(scene.scene, "observer", observer)
    health = ProcessHealth(scene.scene, "observer", observer, time.monotonic(), note=lambda: status().reason)

    def make_metrics() -> "ObserverMetrics":
        # Imported only if metrics are served: prometheus_client takes time to load.
        from observer.runtime.metrics import ObserverMetrics

        return ObserverMetrics(scene.scene, observer, status)

    with serve_health(scene.metrics.listen, health, make_metrics) as metrics:

        def record_frame(age_s: float, step_s: float, sent: bool) -> None:
            health.record_step(time.monotonic())
            if metrics is not None:
                metrics.record_frame(age_s, step_s, sent=sent)

        yield record_frame


class HealthReporter:
    """Combines the camera's reports and the tracker's complaints into one state, and reports each change once.

    The state is `starting` until the first frame, then `running`. It is `degraded` while the camera is lost or frozen
    or, if the camera works, while the tracker complains.
    """

    def __init__(self) -> None:
        self._report: ReportState | None = None
        self._fault, self._complaint, self._started = "", "", False
        self._reported: tuple[ProcessState, str] | None = None

    @property
    def complaint(self) -> str:
        """The tracker's last complaint; "" if all is well."""
        return self._complaint

    def report_to(self, report: ReportState) -> None:
        """From now on call `report(state, reason)` on each change, in the thread that caused it."""
        self._report = report
        self._report_change()

    def record_camera(self, state: ProcessState, reason: str) -> None:
        """A camera's report (`observer.camera.base.Report`): degraded with the reason, or running."""
        self._fault = reason if state == "degraded" else ""
        self._report_change()

    def record_frame(self, complaint: str) -> None:
        """A frame was processed; complaint: why little is found in it, "" if all is well."""
        self._started, self._complaint = True, complaint
        self._report_change()

    def _report_change(self) -> None:
        reason = self._fault or self._complaint
        if self._report is None or not (reason or self._started):
            return
        current: tuple[ProcessState, str] = ("degraded" if reason else "running", reason)
        if current != self._reported:
            self._reported = current
            self._report(*current)
