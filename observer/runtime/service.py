"""One observer on the mesh: the loop around `Observer.step`, and the observer's state, health and metrics."""

import logging
import secrets
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol

from common import SECOND_NS
from common.clock_skew import QUERY_EVERY_S, ClockQuerier, ClockSkew
from common.config import Scene
from common.health import ProcessHealth, serve_health
from common.lifecycle import set_log_identity
from common.link import Link
from common.load import LoadMeter
from common.message_types import STANDING_BY, BodyRegionShares
from common.messages import ProcessState, StatusMessage
from common.status import ProcessStatus, StatusPublisher
from common.vocabulary import Vocabulary
from common.wire import encode_vocabulary
from observer.runtime.pipeline import Posterior, PosteriorPublisher
from observer.runtime.send_on_change import SendOnChange
from observer.tracks import Frame, FrameSource

if TYPE_CHECKING:
    from observer.runtime.metrics import ObserverMetrics


ReportState = Callable[[ProcessState, str], None]
RecordFrame = Callable[[float, float, bool, int], None]
"""Called for each frame with its age at the end of the step and the step's duration, in seconds, whether a posterior
was sent, and how many frames the source skipped before it."""


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

        def record_frame(age_s: float, step_s: float, sent: bool, skipped: int) -> None:
            health.record_step(time.monotonic())
            if metrics is not None:
                metrics.record_frame(age_s, step_s, sent=sent, skipped=skipped)

        yield record_frame


class HealthReporter:
    """Combines the camera's reports and the observer's complaints into one state, and reports each change once.

    The state is `starting` until the first frame, then `running`. It is `degraded` while the camera is lost or frozen
    or, if the camera works, while the observer complains. note: the reason while all is well.
    """

    def __init__(self) -> None:
        self.note = ""
        self._report: ReportState | None = None
        self.complaint = ""
        """The observer's last complaint; "" if all is well."""
        self._fault, self._started = "", False
        self._reported: tuple[ProcessState, str] | None = None

    def report_to(self, report: ReportState) -> None:
        """Call `report(state, reason)` on each change from now on, in the thread that caused it."""
        self._report = report
        self._report_change()

    def record_camera(self, state: ProcessState, reason: str) -> None:
        """Take a camera's report (`observer.camera.base.Report`): degraded with the reason, or running."""
        self._fault = reason if state == "degraded" else ""
        self._report_change()

    def record_frame(self, complaint: str) -> None:
        """Count a processed frame; complaint: as `ObserverLike.complaint`."""
        self._started, self.complaint = True, complaint
        self._report_change()

    def _report_change(self) -> None:
        reason = self._fault or self.complaint
        if self._report is None or not (reason or self._started):
            return
        current: tuple[ProcessState, str] = ("degraded", reason) if reason else ("running", self.note)
        if current != self._reported:
            self._reported = current
            self._report(*current)


log = logging.getLogger("labanmesh.observer")

FUSION_STEPS, LONGEST_STAY_S = 2, 1.0
"""For so many steps of fusion an observer whose source has ended stays on the mesh, and no longer than this."""
SESSION_BYTES = 4
"""Random bytes in the name of a session: enough to tell the starts of one observer apart."""


class ObserverLike(Protocol):
    """What `serve` needs of an observer: `Observer`, or `PicturedObserver` around it."""

    @property
    def vocabulary(self) -> Vocabulary | None:
        """The movements of its model, which may change between two steps; None while it has no model."""

    @property
    def leans_on(self) -> BodyRegionShares | None:
        """The regions of the body that its model leans on; None if unknown."""

    @property
    def complaint(self) -> str:
        """Why the tracker finds little in the pictures, or that it is too slow, and what to do; "" if all is well."""

    def step(self, frame: Frame) -> Posterior | None:
        """The posterior after one more frame; None if the frame was skipped, or without a model."""

    def end(self) -> Posterior | None:
        """The posterior now that the source has ended; None if it shows nothing new."""


class ObserverAround:
    """An `ObserverLike` around another one. meter: complains while the observer is too slow for its source."""

    def __init__(self, observer: ObserverLike, meter: LoadMeter | None = None) -> None:
        self._observer, self._meter = observer, meter

    @property
    def vocabulary(self) -> Vocabulary | None:
        """The vocabulary of the observer."""
        return self._observer.vocabulary

    @property
    def leans_on(self) -> BodyRegionShares | None:
        """What the observer's model leans on."""
        return self._observer.leans_on

    @property
    def complaint(self) -> str:
        """That the observer is too slow, which explains much else; or its own complaint."""
        return (self._meter.complaint if self._meter else "") or self._observer.complaint

    def step(self, frame: Frame) -> Posterior | None:
        """The posterior after one more frame."""
        if self._meter and not frame.repeated:
            self._meter.record(frame.captured_ns, frame.skipped)
        return self._observer.step(frame)

    def end(self) -> Posterior | None:
        """The posterior of the observer now that the source has ended."""
        return self._observer.end()


def serve(
    scene: Scene,
    observer_id: str,
    observer: ObserverLike,
    source: FrameSource,
    link: Link,
    stop: threading.Event,
    clock: Callable[[], int] = time.time_ns,
    health: HealthReporter | None = None,
) -> None:
    """Publish posteriors after each frame, or when they change, until the source ends or `stop` is set.

    After the end of the source the last posterior is that of an ended movement, and the observer stays on the mesh
    until fusion has used it.

    health: the reporter to which the source reports its camera's faults.
    """
    health = health or HealthReporter()
    keys, status = scene.keys, ProcessStatus(scene.scene, observer_id)
    publisher = _posterior_publisher(scene, observer_id, observer.vocabulary, link)
    fusion_clock = FusionClock(ClockQuerier(link, keys.fusion_status(), clock))
    link.answer(keys.vocabulary, lambda: _encoded(scene.scene, publisher.vocabulary))
    with (
        instrument(scene, observer_id, lambda: status.status(clock())) as record_frame,
        StatusPublisher(link, keys.observer_status(observer_id), status, clock) as status_publisher,
    ):
        link.announce(keys.observer_alive(observer_id))
        health.report_to(_state_report(status_publisher, health, observer_id))
        captured_ns = 0
        for frame in source.frames(stop):
            captured_ns, begun_s = frame.captured_ns, time.monotonic()
            posterior = observer.step(frame)
            publisher.follow(observer.vocabulary)
            status.leans_on = observer.leans_on
            now_ns = clock()
            news = posterior if posterior is not None and posterior.judged else None
            sent = news is not None and publisher.publish(news, captured_ns, now_ns)
            record_frame((now_ns - captured_ns) / SECOND_NS, time.monotonic() - begun_s, sent, frame.skipped)
            status.record_frame(captured_ns, now_ns)
            health.record_frame(observer.complaint)
            status_publisher.alive()
            status.clock_skew_s = fusion_clock.skew_s()
        if captured_ns and not stop.is_set():
            _publish_end(observer, publisher, captured_ns, clock())
            stop.wait(min(FUSION_STEPS / scene.fusion.step_hz, LONGEST_STAY_S))
    log.info("%s: %s after %d posteriors", observer_id, "stopped" if stop.is_set() else "source ended", publisher.seq)


def _encoded(scene: str, vocabulary: Vocabulary | None) -> bytes | None:
    return None if vocabulary is None else encode_vocabulary(scene, vocabulary)


def _publish_end(observer: ObserverLike, publisher: PosteriorPublisher, captured_ns: int, now_ns: int) -> None:
    posterior = observer.end()
    if posterior is not None:
        # Fusion only takes posteriors that are newer than the last.
        publisher.publish(posterior, captured_ns + 1, now_ns)


def _state_report(status: StatusPublisher, health: HealthReporter, observer_id: str) -> ReportState:
    """Publishes each change of state, and logs the observer's complaints; sources log their own faults."""

    def report(state: ProcessState, reason: str) -> None:
        status.set_state(state, reason)
        if reason and reason == health.complaint:
            log.warning("%s: %s", observer_id, reason)

    return report


def _posterior_publisher(
    scene: Scene, observer_id: str, vocabulary: Vocabulary | None, link: Link
) -> PosteriorPublisher:
    section = scene.observer(observer_id)
    directed = section.direction == "known"
    # Half of fresh_s: the next posterior arrives before the last one is stale.
    on_change = None if section.say == "each frame" else SendOnChange(scene.fusion.fresh_s / 2, directed)
    publisher, session = link.publisher(scene.keys.posterior(observer_id)), secrets.token_urlsafe(SESSION_BYTES)
    return PosteriorPublisher(vocabulary, publisher, directed, on_change, session)


SILENT_NS = round(3 * QUERY_EVERY_S * SECOND_NS)
"""An owner that has answered nothing for so long has gone: three questions."""
CLOCKS_LIMIT = 16
"""Estimates that are kept; a scene has two or three services."""


class FusionClock:
    """Measures the clock of the fusion service that speaks for the scene; that of this machine is passed in.

    1. Each service has an estimate of its own: they may run on machines with different clocks.
    2. What counts is the owner's, the service that publishes. A service that stands by says so in its status.
    3. Of several that publish, as while a network is split, the first one counts until it stands by or is silent.
    """

    def __init__(self, querier: ClockQuerier) -> None:
        self._querier = querier
        self._skews: dict[str, ClockSkew] = {}
        self._owner, self._owner_answered_ns = "", 0

    def skew_s(self) -> float | None:
        """Seconds by which our clock is ahead of the owner's; None before its first answer. To be called in a loop."""
        self._querier.ask_if_due()
        for status, reading in self._querier.readings():
            # The one that answered last is the last in the dictionary.
            self._skews[status.id] = skew = self._skews.pop(status.id, None) or ClockSkew()
            skew.note(reading)
            if status.reason.startswith(STANDING_BY):
                self._owner = "" if self._owner == status.id else self._owner
            elif status.id == self._owner or self._is_silent(reading.answered_ns):
                self._owner, self._owner_answered_ns = status.id, reading.answered_ns
        while len(self._skews) > CLOCKS_LIMIT:
            del self._skews[next(name for name in self._skews if name != self._owner)]
        ahead_s = self._skews[self._owner].skew_s if self._owner else None
        return None if ahead_s is None else -ahead_s

    def _is_silent(self, now_ns: int) -> bool:
        return not self._owner or abs(now_ns - self._owner_answered_ns) > SILENT_NS
