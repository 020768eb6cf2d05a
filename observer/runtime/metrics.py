"""Prometheus metrics of an observer: frames, posteriors, their age and the time of a step."""

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from common.messages import StatusMessage
from common.metrics import AGE_BUCKETS, STEP_BUCKETS, Metrics, seconds

if TYPE_CHECKING:
    from prometheus_client import Metric


class ObserverMetrics(Metrics):
    """The metrics of one observer of a scene."""

    def __init__(self, scene: str, observer: str, status: Callable[[], StatusMessage]) -> None:
        super().__init__("observer", {"scene": scene, "observer": observer}, status)
        self._frames = self.counter("frames", "Frames worked on.")
        self._skipped = self.counter("frames_skipped", "Frames left out, as newer ones were there when it was ready.")
        self._posteriors = self.counter("posteriors", "Posteriors published.")
        self._age = self.histogram("frame_age_seconds", "From the capture of a frame to its posterior.", AGE_BUCKETS)
        self._step = self.histogram("observer_step_seconds", "Tracking and filtering, for one frame.", STEP_BUCKETS)

    def record_frame(self, age_s: float, step_s: float, *, sent: bool, skipped: int) -> None:
        """Count one processed frame. sent: whether a posterior was published. skipped: frames left out before it."""
        self._frames.inc()
        self._skipped.inc(skipped)
        self._posteriors.inc(sent)
        self._age.observe(age_s)
        self._step.observe(step_s)

    def collect_own(self, status: StatusMessage | None) -> "Iterable[Metric]":
        """The newest frame's time and the clock skew, read from the status."""
        newest = seconds(status.last_frame_ns) if status else None
        yield self.gauge("last_frame_timestamp_seconds", "When the newest frame was captured.", [((), newest)])
        skew_s = status.skew_s if status else None
        yield self.gauge("clock_skew_seconds", "How far this clock is ahead of the fusion service's.", [((), skew_s)])
