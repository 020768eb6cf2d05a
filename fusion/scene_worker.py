"""Fuses one scene in this process: posteriors in, judgements and verdicts out."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from common import SECOND_NS
from common.clock_skew import ClockQuerier
from common.config import Scene
from common.inbox import Arrival
from common.keys import observer_of
from common.link import Link, Publisher
from common.load import LoadMeter
from common.messages import JudgementMessage, ObserverStatistics, VerdictMessage
from common.notify import Notifier
from common.status import ProcessStatus
from common.subsession import SubSession
from common.vocabulary import Vocabulary
from common.wire import encode_vocabulary
from fusion.checkpoint import FORGET_S, NOTHING_LEARNED, Checkpoint, CheckpointFile
from fusion.engine.engine import EngineOutput, FusionEngine
from fusion.engine.pooling import PooledPosterior, PoolingCase
from fusion.engine.roster import POOLED_STATES
from fusion.ingest import PosteriorIngest, newest
from fusion.publisher import Reachability, VerdictPublisher
from fusion.reconciliation import UnreconciledMovement

log = logging.getLogger("labanmesh.fusion")
WAY_OUT = "find out who sends so many (labanmesh doctor), or run fuse on a faster machine"
RECEPTION_TIMEOUT_S = 0.3
"""A service that has received no posterior for so long is disconnected itself, rather than the owner silent."""


@dataclass(frozen=True, slots=True)
class Service:
    """What all scenes of one fusion service share.

    own: its id. session: random per process, to notice a second process of the same id. clock: Unix epoch in ns.
    ticks: monotonic seconds. shared: whether scenes that name no standby services are shared by all services. polled:
    whether messages wait until the step that takes them (many scenes) instead of being received by a thread for each
    subscription. wake: called when the loop has work. ask_clocks_s: seconds between two readings of a clock.
    put: sends a judgement, now or with those of other scenes. supervisor: receives the state of the scene, if there is
    only one.
    """

    own: str
    session: str
    link: Link
    clock: Callable[[], int]
    ticks: Callable[[], float]
    shared: bool
    polled: bool
    wake: Callable[[], None]
    ask_clocks_s: float
    put: Callable[[Publisher, bytes], None]
    supervisor: Notifier


@dataclass(frozen=True, slots=True)
class StepInput:
    """The first half of a step: how many posteriors were received and read, and the case to pool, if any."""

    received: int = 0
    read: int = 0
    now_ns: int = 0
    case: PoolingCase | None = None


@dataclass(frozen=True, slots=True)
class StepResult:
    """The second half of a step: the judgement, if there is one, and the verdicts that were published."""

    output: EngineOutput | None = None
    published: Sequence[VerdictMessage] = ()


class SceneWorker:
    """An engine with its subscriptions and publications, which end with `close`.

    fuses: whether posteriors are fused, not only received. owns: whether the results are published; `epoch` goes with
    them. restored: whether the engine continues from messages of another service or an earlier process. present: the
    observers that are. checkpoint: what another service needs to continue.
    """

    def __init__(
        self,
        scene: Scene,
        service: Service,
        engine: FusionEngine,
        status: ProcessStatus,
        file: CheckpointFile | None,
        hand_over: Callable[[str], bytes | None],
        session: SubSession | None = None,
    ) -> None:
        """hand_over: called between two steps with the id of a service that asks for the scene. session: shared by
        several workers of the scene."""
        self._scene, self._own, self._clock = scene, service.own, service.clock
        self._engine, self._status = engine, status
        self._session = session or service.link.sub_session(polled=service.polled)
        # Always polled: ownership changes between two steps only.
        self._requests = session or service.link.sub_session(polled=True)
        self._requests.answer_requests(
            scene.keys.fusion_handover(service.own), lambda payload: hand_over(payload.decode("ascii", "replace"))
        )
        # With many scenes by whole keys: with 250 wildcards, which Zenoh tries one by one, a message costs ten times as
        # much. With few scenes the server has one inbox.
        names = map(scene.keys.posterior, scene.roster) if service.polled else ()
        self._posteriors, alive = self._session.newest(*names), scene.keys.observer_alive
        self.present = self._session.presence(alive(), map(alive, scene.roster))
        self._alive: frozenset[str] | None = None
        self._ingest = PosteriorIngest(engine, service.clock)
        status_keys = scene.keys.observer_status()
        self._clocks = ClockQuerier(self._session, status_keys, self._clock, service.wake, service.ask_clocks_s)
        is_full = scene.fusion.votes == "full"
        self._publisher = VerdictPublisher(self._session, scene.keys, engine, file, is_full, service.put)
        self.checkpoint = self._publisher.checkpoint
        self._vocabulary = encode_vocabulary(scene.scene, engine.vocabulary, service.own)
        self._session.answer(scene.keys.vocabulary, lambda: self._vocabulary)
        self._withheld: list[VerdictMessage] = []
        self._unreconciled: UnreconciledMovement | None = None
        self._received_s = service.ticks()
        self._reachable, self._link, self._ticks = Reachability(), service.link, service.ticks
        self._waiting: bool | None = None
        self._load = LoadMeter("posteriors", WAY_OUT)
        self.fuses = self.owns = self.restored = False
        self.epoch = 0

    @property
    def complaint(self) -> str:
        """That more posteriors arrive than can be read, and what to do; "" if all is well."""
        return self._load.complaint

    @property
    def at_rest(self) -> bool:
        """Whether no movement is in progress."""
        return self._publisher.at_rest

    def poll_requests(self) -> None:
        """Answer a handover request, if one has arrived."""
        self._requests.poll()

    def collect(self, arrivals: Sequence[Arrival] = ()) -> StepInput:
        """Receive `arrivals` and everything else that has arrived; the result has the case to pool."""
        self._session.poll()
        arrivals = arrivals or self._posteriors.take()
        self._received_s = self._ticks() if arrivals else self._received_s
        read = newest(arrivals)
        self._load.record(round(self._ticks() * SECOND_NS), len(arrivals) - len(read), len(read))
        if read and (frames_ns := self._ingest.take(*read)):
            self._status.record_frames(frames_ns, self._clock())
        if self.present.alive is not self._alive:
            # After the posteriors: a last one must not bring back an observer that has gone.
            self._alive = self.present.alive
            self._engine.set_present(frozenset(map(observer_of, self._alive)))
        if not self.fuses:
            return StepInput(len(arrivals), len(read))
        now_ns = self._clock()
        return StepInput(len(arrivals), len(read), now_ns, self._engine.pooling_case(now_ns))

    def finish(self, step: StepInput, pooled: PooledPosterior | None = None) -> StepResult:
        """Fuse what `collect` returned, and publish the result if this service owns the scene.

        pooled: the pooled posterior of the step's case; None: it is pooled here. A standby service withholds its
        verdicts: the owner publishes them, or, if the owner stops, this service.
        """
        self._publisher.answers = self.owns
        if step.case is None:
            return StepResult()
        self._engine.epoch = self.epoch if self.owns else None
        output = self._engine.output_for(step.case.posteriors, step.now_ns, pooled)
        if self._unreconciled is not None and self.owns:
            self._unreconciled.record_message(output.judgement)
        self._withheld += output.verdicts
        # While the router is away, verdicts wait, and judgements with them.
        if not self.owns or (not self._is_reachable() and self._withheld):
            return StepResult(output)
        published, self._withheld = self._withheld, []
        self._publisher.publish(published, output.judgement, self._vocabulary, self._ticks())
        self._log_waiting(output.judgement)
        return StepResult(output, published)

    def read_clocks(self) -> None:
        """Ask for the observers' clocks if it is due, and take the answers; after a step, when no listener waits."""
        if self._clocks.ask_if_due():
            self._status.observers = self.statistics()
        for status, reading in self._clocks.readings():
            self._engine.record_clock(status.id, reading)

    def statistics(self) -> dict[str, ObserverStatistics]:
        """Clock skew and rejected messages of each observer."""
        return self._ingest.statistics(self._scene.roster)

    def _is_reachable(self) -> bool:
        return self._scene.mesh.mode != "router" or self._reachable.update(
            self._link.connected, self._received_s, self._ticks()
        )

    def is_receiving(self, now_s: float) -> bool:
        """Whether posteriors arrive, or no observer is present."""
        return not self.present.alive or now_s - self._received_s < RECEPTION_TIMEOUT_S

    def stand_down(self) -> None:
        """Stop publishing, because another service is the owner: see reconciliation.py."""
        verdict = self._publisher.unfinished
        if verdict is not None:
            self._unreconciled = UnreconciledMovement(verdict, self._clock(), self._publisher.judgement_payload)

    def reconcile(self) -> bool:
        """Publish the end of the movement in which this service stood down, once it is due, and verdicts that may be
        lost (reconciliation.py). Returns whether nothing is left to publish; to be called at every step.
        """
        is_reachable = self._is_reachable()
        now_s = self._ticks()
        self._publisher.repeat_verdicts(self._reachable.lost_from(now_s), now_s)
        if self._unreconciled is None:
            return is_reachable
        now_ns = self._clock()
        same_as = self._unreconciled.same_as(now_ns)
        if same_as is not None:
            # With an epoch it would be the message of an owner, for which the present one would stand by.
            self._engine.epoch = None
            self._publisher.close(self._engine.close(self._unreconciled.verdict, now_ns, now_ns, same_as))
        if self._unreconciled.should_repeat(now_ns):
            self._publisher.repeat(self._unreconciled.judgement)
        if self._unreconciled.is_reconciled:
            self._unreconciled = None
        return self._unreconciled is None

    def adopt(self, message: JudgementMessage) -> None:
        """Continue the movement of a service that stands down, if this one has none; say which are the same."""
        if isinstance(message, VerdictMessage) and (same_as := self._publisher.shared.same_as(message)) is not None:
            ended_ns = message.ended_ns or message.decided_ns
            self._publisher.close(self._engine.close(message, ended_ns, self._clock(), same_as))
        movement = message.movement
        if movement is not None and not self._publisher.knows(movement.id) and self._engine.adopt(message):
            log.info("%s: goes on with %s of %s", self._scene.scene, movement.id, message.fusion)

    @property
    def observed_vocabulary(self) -> str | None:
        """The hash of the vocabulary in which most observers publish; None if there is no majority."""
        return self._engine.observed_vocabulary(self._clock())

    def change_vocabulary(self, vocabulary: Vocabulary) -> None:
        """Fuse posteriors in `vocabulary` from now on; the owner ends a decided movement first, and publishes the new
        vocabulary, so that listeners need not ask for it."""
        ended = self._engine.change_vocabulary(vocabulary, self._clock())
        self._vocabulary = encode_vocabulary(self._scene.scene, vocabulary, self._own)
        if self.owns:
            self._publisher.change_vocabulary([*self._withheld, *ended], self._vocabulary, self._ticks())
        self._withheld.clear()
        log.info("%s: new vocabulary: %s", self._scene.scene, ", ".join(vocabulary.labels))

    def take_times(self, vocabulary: Vocabulary) -> None:
        """Take the durations of the same movements in `vocabulary`; the owner publishes them with the next step."""
        self._engine.take_times(vocabulary)
        self._vocabulary = encode_vocabulary(self._scene.scene, vocabulary, self._own)

    def _log_waiting(self, judgement: JudgementMessage) -> None:
        if (waiting := judgement.agreement.n == 0) != self._waiting:
            self._waiting = waiting
            counted = [name for name, vote in judgement.votes.items() if vote.state in POOLED_STATES]
            text = "waiting for observers" if waiting else f"fusing {', '.join(counted)}"
            log.info("%s: %s", self._scene.scene, text)

    def follow(self, message: JudgementMessage) -> None:
        """Continue from the owner's message; this engine decides again what the owner has not published."""
        self._withheld.clear()
        if self._unreconciled is not None:
            self._unreconciled.record_message(message)
        if isinstance(message, VerdictMessage) and (
            self._publisher.has_published(message) or message.same_as is not None
        ):
            # The owner repeats it, because it may have been lost, or says which ids are one movement: another movement
            # may be in progress.
            return
        self._engine.continue_from(message)
        self._publisher.remember(message)
        self.restored = True

    def restore(self, checkpoint: Checkpoint) -> None:
        """Continue from `checkpoint`; of one older than FORGET_S a decided movement ends when it was judged last.

        What was learned about observers in another vocabulary was learned about other models, and is forgotten.
        """
        if checkpoint.judgement.vocabulary.hash != self._engine.vocabulary.digest:
            checkpoint = checkpoint.model_copy(update={"reliability": NOTHING_LEARNED})
        if checkpoint.age_s(self._clock()) <= FORGET_S:
            self._publisher.restore(checkpoint)
        else:
            self._engine.reliability = checkpoint.reliability
            if checkpoint.unfinished is not None:
                ended_ns = checkpoint.judgement.at_ns
                self._withheld.append(self._engine.close(checkpoint.unfinished, ended_ns, self._clock()))
        self.restored = True

    def close(self) -> None:
        """End all subscriptions and publications."""
        self._requests.close()
        self._session.close()
