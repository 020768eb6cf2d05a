"""Judges one person of a scene: posteriors in, judgements and verdicts out. Most scenes have one person."""

import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from common.config import Scene
from common.inbox import Presence
from common.keys import observer_of
from common.messages import JudgementMessage, ObserverPosterior, VerdictMessage
from common.status import ProcessStatus
from common.subsession import SubSession
from common.vocabulary import Vocabulary
from fusion.checkpoint import FORGET_S, NOTHING_LEARNED, Checkpoint, CheckpointFile
from fusion.engine.engine import FusionEngine
from fusion.engine.pooling import PooledPosterior, PoolingCase
from fusion.engine.roster import POOLED_STATES
from fusion.ingest import PosteriorIngest
from fusion.publisher import VerdictPublisher
from fusion.reconciliation import UnreconciledMovement
from fusion.service import Service

log = logging.getLogger("labanmesh.fusion")


@dataclass(slots=True)
class Duty:
    """What a service does for a scene now.

    fuses: whether posteriors are fused, not only received. owns: whether the results are published; `epoch` goes with
    them. restored: whether the engines continue from messages of another service or an earlier process.
    """

    fuses: bool = False
    owns: bool = False
    restored: bool = False
    epoch: int = 0


class PersonWorker:
    """An engine with its publications."""

    def __init__(
        self,
        scene: Scene,
        service: Service,
        engine: FusionEngine,
        status: ProcessStatus,
        file: CheckpointFile | None,
        session: SubSession,
        duty: Duty,
        is_reachable: Callable[[], bool],
    ) -> None:
        """session, duty: of the scene. is_reachable: whether listeners receive what is published now."""
        self._scene, self._clock, self._ticks = scene.scene, service.clock, service.ticks
        self.engine, self._status, self._duty, self._is_reachable = engine, status, duty, is_reachable
        is_full = scene.fusion.votes == "full"
        self.publisher = VerdictPublisher(session, scene.keys, engine, file, is_full, service.put)
        self._alive: frozenset[str] | None = None
        self._withheld: list[VerdictMessage] = []
        self._own_ids: dict[str, str | None] = {}
        """Of the movements of other services that go on here, the ids under which this one had ended them, if any."""
        self._unreconciled: UnreconciledMovement | None = None
        self._waiting: bool | None = None
        self.judgement: JudgementMessage | None = None
        """The last one that was made here, published or not."""

    @property
    def at_rest(self) -> bool:
        """Whether no movement is in progress."""
        return self.publisher.at_rest

    def collect(
        self, posteriors: Iterable[ObserverPosterior], ingest: PosteriorIngest, present: Presence
    ) -> tuple[int, PoolingCase | None]:
        """Take what has arrived about this person; returns the time, and the case to pool if the service fuses."""
        if frames_ns := ingest.pass_on(posteriors, self.engine, self._clock()):
            self._status.record_frames(frames_ns, self._clock())
        if present.alive is not self._alive:
            # After the posteriors: a last one must not bring back an observer that has gone.
            self._alive = present.alive
            self.engine.roster.set_present(frozenset(map(observer_of, self._alive)))
        now_ns = self._clock()
        return now_ns, self.engine.pooling_case(now_ns) if self._duty.fuses else None

    def finish(
        self, now_ns: int, case: PoolingCase, pooled: PooledPosterior, vocabulary: bytes
    ) -> Sequence[VerdictMessage]:
        """Fuse what `collect` returned, and publish the result if this service owns the scene.

        pooled: the pooled posterior of the case. vocabulary: its message. Returns the verdicts that were published. A
        standby service withholds its verdicts: the owner publishes them, or, if the owner stops, this service.
        """
        owns = self._duty.owns
        self.engine.epoch = self._duty.epoch if owns else None
        output = self.engine.output_for(case.posteriors, now_ns, pooled)
        self.judgement = output.judgement
        if self._unreconciled is not None and owns:
            self._unreconciled.record_message(output.judgement)
        self._withheld += map(self._named, output.verdicts)
        # While the router is away, verdicts wait, and judgements with them.
        if not owns or (not self._is_reachable() and self._withheld):
            return ()
        published, self._withheld = self._withheld, []
        self.publisher.publish(published, output.judgement, vocabulary, self._ticks())
        self._log_waiting(output.judgement)
        return published

    def stand_down(self) -> None:
        """Stop publishing, because another service is the owner: see reconciliation.py."""
        verdict = self.publisher.unfinished
        if verdict is not None:
            self._unreconciled = UnreconciledMovement(verdict, self._clock(), self.publisher.judgement_payload)

    def reconcile(self, lost_from_s: float, doubtful_from_s: float) -> bool:
        """Publish the end of the movement in which this service stood down, once it is due, and verdicts that may be
        lost, those since `lost_from_s` (reconciliation.py); keep the ends since `doubtful_from_s` in the file until
        then. Returns whether no such movement is left.
        """
        self.publisher.repeat_verdicts(lost_from_s, self._ticks())
        self.publisher.keep_undelivered(doubtful_from_s)
        if self._unreconciled is None:
            return True
        now_ns = self._clock()
        same_as = self._unreconciled.same_as(now_ns)
        if same_as is not None:
            # With an epoch it would be the message of an owner, for which the present one would stand by.
            self.engine.epoch = None
            self.publisher.close(self.engine.close(self._unreconciled.verdict, now_ns, now_ns, same_as))
        if self._unreconciled.should_repeat(now_ns):
            self.publisher.repeat(self._unreconciled.judgement)
        if self._unreconciled.is_reconciled:
            self._unreconciled = None
        return self._unreconciled is None

    def adopt(self, message: JudgementMessage) -> None:
        """Continue the movement of a service that stands down, if this one has none; say which are the same."""
        if isinstance(message, VerdictMessage) and (same_as := self.publisher.shared.same_as(message)) is not None:
            ended_ns = message.ended_ns or message.decided_ns
            self.publisher.close(self.engine.close(message, ended_ns, self._clock(), same_as))
        movement = message.movement
        if movement is not None and not self.publisher.knows(movement.id) and self.engine.adopt(message):
            log.info("%s: goes on with %s of %s", self._scene, movement.id, message.fusion)
            self._own_ids[movement.id] = self.publisher.shared.goes_on(message)

    def _named(self, verdict: VerdictMessage) -> VerdictMessage:
        """The verdict, with `same_as` if this service has ended the same movement before under an id of its own."""
        own_id = None if verdict.ended_ns is None else self._own_ids.pop(verdict.id, None)
        return verdict if own_id is None else verdict.model_copy(update={"same_as": own_id})

    def change_vocabulary(self, vocabulary: Vocabulary, payload: bytes) -> None:
        """Fuse posteriors in `vocabulary` from now on; the owner ends a decided movement first, and publishes the new
        vocabulary, its message `payload`, so that listeners need not ask for it."""
        ended = self.engine.change_vocabulary(vocabulary, self._clock())
        if self._duty.owns:
            self.publisher.change_vocabulary([*self._withheld, *ended], payload, self._ticks())
        self._withheld.clear()

    def follow(self, message: JudgementMessage) -> None:
        """Continue from the owner's message; this engine decides again what the owner has not published."""
        self._withheld.clear()
        if self._unreconciled is not None:
            self._unreconciled.record_message(message)
        if isinstance(message, VerdictMessage) and (
            self.publisher.has_published(message) or message.same_as is not None
        ):
            # The owner repeats it, because it may have been lost, or says which ids are one movement: another movement
            # may be in progress.
            return
        self.engine.continue_from(message)
        self.publisher.remember(message)
        self._duty.restored = True

    def restore(self, checkpoint: Checkpoint) -> None:
        """Continue from `checkpoint`, and send again the ends that listeners may not have; of one older than FORGET_S a
        decided movement ends when it was judged last.

        What was learned about observers in another vocabulary was learned about other models, and is forgotten.
        """
        # What this engine decided until now, the other service has decided.
        self._withheld.clear()
        if checkpoint.judgement.vocabulary.hash != self.engine.vocabulary.digest:
            checkpoint = checkpoint.model_copy(update={"reliability": NOTHING_LEARNED})
        ends = [(each, each.ended_ns or each.decided_ns) for each in checkpoint.undelivered]
        if checkpoint.age_s(self._clock()) <= FORGET_S:
            self.publisher.restore(checkpoint)
        else:
            self.engine.reliability = checkpoint.reliability
            if checkpoint.unfinished is not None:
                ends.append((checkpoint.unfinished, checkpoint.judgement.at_ns))
        self._withheld += [self.engine.close(verdict, ended_ns, self._clock()) for verdict, ended_ns in ends]

    def _log_waiting(self, judgement: JudgementMessage) -> None:
        if (waiting := judgement.agreement.n == 0) != self._waiting:
            self._waiting = waiting
            counted = [name for name, vote in judgement.votes.items() if vote.state in POOLED_STATES]
            text = "waiting for observers" if waiting else f"fusing {', '.join(counted)}"
            log.info("%s: %s", self._scene, text)
