"""One observer on the mesh: reads frames, publishes posteriors and its status. The loop around `Observer.step`."""

import logging
import secrets
import threading
import time
from collections.abc import Callable
from typing import Protocol

from common import SECOND_NS
from common.clock_skew import ClockQuerier, ClockSkew
from common.config import Scene
from common.link import Link, Publisher
from common.messages import ProcessState
from common.status import ProcessStatus, StatusPublisher
from common.vocabulary import Vocabulary
from common.wire import encode, encode_vocabulary
from observer.runtime.instrumentation import HealthReporter, ReportState, instrument
from observer.runtime.pipeline import Posterior
from observer.runtime.posterior_encoder import PosteriorEncoder, SendOnChange
from observer.tracks import Frame, FrameSource

log = logging.getLogger("labanmesh.observer")

SESSION_BYTES = 4
"""Random bytes in the name of a session: enough to tell the starts of one observer apart."""


class ObserverLike(Protocol):
    """What `serve` needs of an observer: `Observer`, or `PreviewingObserver` around it."""

    @property
    def vocabulary(self) -> Vocabulary:
        """The movements of its model."""

    @property
    def complaint(self) -> str:
        """Why the tracker finds little in the pictures, and what to do about it; "" if all is well."""

    def step(self, frame: Frame) -> Posterior | None:
        """The posterior after one more frame; None if there is nothing to publish yet."""


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

    health: the reporter to which the source reports its camera's faults.
    """
    health = health or HealthReporter()
    keys, status = scene.keys, ProcessStatus(scene.scene, observer_id)
    publisher = _posterior_publisher(scene, observer_id, observer.vocabulary, link)
    querier, fusion_clock = ClockQuerier(link, keys.fusion_status(), clock), ClockSkew()
    vocabulary = encode_vocabulary(scene.scene, observer.vocabulary)
    link.answer(keys.vocabulary, lambda: vocabulary)
    with (
        instrument(scene, observer_id, lambda: status.status(clock())) as record_frame,
        StatusPublisher(link, keys.observer_status(observer_id), status, clock) as status_publisher,
    ):
        link.announce(keys.observer_alive(observer_id))
        health.report_to(_state_report(status_publisher, health, observer_id))
        for frame in source.frames(stop):
            begun_s = time.monotonic()
            posterior = observer.step(frame)
            now_ns = clock()
            sent = posterior is not None and publisher.publish(posterior, frame.captured_ns, now_ns)
            record_frame((now_ns - frame.captured_ns) / SECOND_NS, time.monotonic() - begun_s, sent)
            status.record_frame(frame.captured_ns, now_ns)
            health.record_frame(observer.complaint)
            status_publisher.alive()
            querier.ask_if_due()
            for _, reading in querier.readings():
                fusion_clock.note(reading)
                status.set_clock_skew(-(fusion_clock.skew_s or 0.0))
    log.info("%s: %s after %d posteriors", observer_id, "stopped" if stop.is_set() else "source ended", publisher.seq)


def _state_report(status: StatusPublisher, health: HealthReporter, observer_id: str) -> ReportState:
    """Publishes each change of state, and logs the tracker's complaints; sources log their own faults."""

    def report(state: ProcessState, reason: str) -> None:
        status.set_state(state, reason)
        if reason and reason == health.complaint:
            log.warning("%s: %s", observer_id, reason)

    return report


class PosteriorPublisher:
    """Publishes posteriors on the mesh; directed: see PosteriorEncoder; on_change: None to send each one."""

    def __init__(
        self, vocabulary: Vocabulary, publisher: Publisher, directed: bool = True, on_change: SendOnChange | None = None
    ) -> None:
        self._encoder = PosteriorEncoder(vocabulary, secrets.token_urlsafe(SESSION_BYTES), directed)
        self._publisher, self._on_change = publisher, on_change

    @property
    def seq(self) -> int:
        """Number of posteriors sent."""
        return self._encoder.seq

    def publish(self, posterior: Posterior, captured_ns: int, now_ns: int) -> bool:
        """Send the posterior of the frame captured at `captured_ns`, unless it hardly changed; whether it was sent."""
        if self._on_change is not None and not self._on_change.should_send(posterior, captured_ns):
            return False
        self._publisher.put(encode(self._encoder.encode(posterior, captured_ns, now_ns)))
        return True


def _posterior_publisher(scene: Scene, observer_id: str, vocabulary: Vocabulary, link: Link) -> PosteriorPublisher:
    section = scene.observer(observer_id)
    directed = section.direction == "known"
    # Half of fresh_s: the next posterior arrives before the last one is stale.
    on_change = None if section.say == "each frame" else SendOnChange(scene.fusion.fresh_s / 2, directed)
    return PosteriorPublisher(vocabulary, link.publisher(scene.keys.posterior(observer_id)), directed, on_change)
