"""One observer on the mesh: frames in, posteriors out, and how it is. The loop around `Observer.step`."""

import logging
import secrets
import threading
import time
from collections.abc import Callable
from typing import Protocol

from common.clock_skew import ClockQuerier, ClockSkew
from common.config import Scene
from common.link import Link, Publisher
from common.messages import ProcessState
from common.status import ProcessStatus, StatusPublisher
from common.vocabulary import Vocabulary
from common.wire import encode, encode_vocabulary
from observer.runtime.instrumentation import HealthReporter, Tell, telling
from observer.runtime.pipeline import Posterior
from observer.runtime.posterior_encoder import PosteriorEncoder, SendOnChange
from observer.tracks import Frame, FrameSource

log = logging.getLogger("labanmesh.observer")

SESSION_BYTES = 4
"""Of a session's name, at random: no two starts of an observer within anybody's memory get the same."""


class ObserverLike(Protocol):
    """What the service needs of an observer."""

    @property
    def vocabulary(self) -> Vocabulary:
        """The movements that it tells apart."""

    @property
    def complaint(self) -> str:
        """Why little can be made out in the pictures, and what to do; "" when all is well."""

    def step(self, frame: Frame) -> Posterior | None:
        """One frame; None when there is nothing to say yet."""


def serve(
    scene: Scene,
    observer_id: str,
    observer: ObserverLike,
    source: FrameSource,
    link: Link,
    stop: threading.Event,
    clock: Callable[[], int] = time.time_ns,
    condition: HealthReporter | None = None,
) -> None:
    """Say what `observer` believes after each frame, or when it has changed, until the source ends or `stop` is set.

    condition: the one to which the source reports what is wrong with its camera.
    """
    condition = condition or HealthReporter()
    keys = scene.keys
    health = ProcessStatus(scene.scene, observer_id)
    directed = scene.observer(observer_id).direction == "known"
    spoken = link.publisher(keys.posterior(observer_id))
    speaker = PosteriorPublisher(observer.vocabulary, spoken, directed, _restraint(scene, observer_id))
    asker, fusion_clock = ClockQuerier(link, keys.fusion_status(), clock), ClockSkew()
    names = encode_vocabulary(scene.scene, observer.vocabulary)
    link.answer(keys.vocabulary, lambda: names)
    told = telling(scene, observer_id, lambda: health.status(clock()))
    with told as tell_frame, StatusPublisher(link, keys.observer_status(observer_id), health, clock) as board:
        link.announce(keys.observer_alive(observer_id))
        condition.tell_to(_teller(board, condition, observer_id))
        for frame in source.frames(stop):
            begun_s = time.monotonic()
            opinion = observer.step(frame)
            now_ns = clock()
            said = opinion is not None and speaker.publish(opinion, frame.captured_ns, now_ns)
            tell_frame((now_ns - frame.captured_ns) / 1e9, time.monotonic() - begun_s, said)
            health.record_frame(frame.captured_ns, now_ns)
            condition.frame(observer.complaint)
            board.alive()
            asker.ask_if_due()
            for _, reading in asker.readings():
                fusion_clock.note(reading)
                health.set_clock_skew(-(fusion_clock.skew_s or 0.0))
    log.info("%s: %s after %d posteriors", observer_id, "stopped" if stop.is_set() else "source ended", speaker.seq)


def _teller(board: StatusPublisher, condition: HealthReporter, observer_id: str) -> Tell:
    """A change of condition goes to the mesh, and into the log what no source has logged itself."""

    def tell(state: ProcessState, reason: str) -> None:
        board.set_state(state, reason)
        if reason and reason == condition.complaint:
            log.warning("%s: %s", observer_id, reason)

    return tell


def _restraint(scene: Scene, observer_id: str) -> SendOnChange | None:
    """None where every opinion is said. With it one is said in time for the next to come before it is old."""
    if scene.observer(observer_id).say == "each frame":
        return None
    return SendOnChange(scene.fusion.fresh_s / 2, scene.observer(observer_id).direction == "known")


class PosteriorPublisher:
    """Publishes posteriors on the mesh. directed: see PosteriorEncoder."""

    def __init__(
        self, vocabulary: Vocabulary, publisher: Publisher, directed: bool = True, restraint: SendOnChange | None = None
    ) -> None:
        self._minutes = PosteriorEncoder(vocabulary, secrets.token_urlsafe(SESSION_BYTES), directed)
        self._publisher, self._restraint = publisher, restraint

    @property
    def seq(self) -> int:
        """How many opinions were said."""
        return self._minutes.seq

    def publish(self, opinion: Posterior, captured_ns: int, now_ns: int) -> bool:
        """Publish one opinion about the frame captured at `captured_ns`; whether that was worth saying."""
        if self._restraint is not None and not self._restraint.should_send(opinion, captured_ns):
            return False
        self._publisher.put(encode(self._minutes.encode(opinion, captured_ns, now_ns)))
        return True
