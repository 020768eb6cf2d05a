"""The membership of a fusion service in one scene that it may share with other services.

1. ownership.py decides which role the service has; this file acts on the role.
2. The owner fuses and publishes. A standby service that the scene file names fuses the same posteriors, follows what
   the owner publishes and withholds its own verdicts until it takes over. Where scenes are shared, the next in rank
   only keeps the last messages of the owner.
3. A handover request is answered between two steps, under the service's own exact key, with the checkpoint of the
   scene. A query of a listener changes nothing.
4. What the scene file does not say of the vocabulary is the observers' (fusion.md, "A new vocabulary").
"""

import logging
from dataclasses import replace

from common.config import Scene
from common.keys import observer_of as service_of
from common.message_types import OVERLOADED, SAME_ID_REASON, STANDING_BY
from common.messages import JudgementMessage, ProcessState
from common.status import ProcessStatus, StatusPublisher
from common.vocabulary import Vocabulary
from fusion.checkpoint import Checkpoint, checkpoint_files
from fusion.engine.engine import FusionEngine
from fusion.fall_watch import FallWatch
from fusion.ownership import Ownership, Role
from fusion.same_id import SameIdDetector, SameIdWatch, Stance
from fusion.scene_worker import SceneWorker
from fusion.service import Service
from fusion.standby import HandoverRequest, StandbyListener, VocabularyLookup

log = logging.getLogger("labanmesh.fusion")
STEPS_MISSED = 2.5
"""A service that judges at every step is not silent before it has missed this many."""
SHARED_TAKEOVER_S = 2.0
"""A process that takes over a hundred scenes at once is busy for some tenths of a second, and is not silent."""
ASKING = "asking the observers for their vocabulary"


class SceneMember:
    """The membership of this service in one scene; `worker` fuses the scene while the role requires it.

    Raises BadInput for an unknown fusion rule, or a rule that cannot pool so many observers.
    """

    def __init__(self, scene: Scene, service: Service) -> None:
        self.scene, self._service = scene, service
        ranked = () if service.shared and not scene.fusion.standby else scene.services
        takeover_s = max(scene.fusion.takeover_s, STEPS_MISSED / scene.fusion.step_hz)
        if not ranked:
            takeover_s = max(takeover_s, SHARED_TAKEOVER_S)
        self.ownership = Ownership(service.own, scene.scene, ranked, takeover_s)
        self._is_warm = len(ranked) > 1
        """Whether this service fuses also while it stands by."""
        self._files = checkpoint_files(scene, service.own)
        self.vocabulary = scene.named_vocabulary
        if self.vocabulary is not None:
            # A bad rule is an error now, not when the scene is taken over.
            self._new_engine(self.vocabulary, None)
        self.status = ProcessStatus(scene.scene, service.own)
        self.status.session = service.session
        self._session = service.link.sub_session(polled=service.polled)
        own, supervisor = scene.keys.fusion_status(service.own), service.supervisor
        self._status_publisher = StatusPublisher(self._session, own, self.status, service.clock, supervisor=supervisor)
        self._services = self._session.presence(scene.keys.fusion_alive(), map(scene.keys.fusion_alive, scene.services))
        detector = SameIdDetector(service.session, service.ticks(), takeover_s)
        self._same_id, self._id_is_shared = SameIdWatch(self._session, scene.keys, service.own, detector), False
        self._alive: frozenset[str] | None = None
        self._updated_s = float("-inf")
        self._listener: StandbyListener | None = None
        self.worker: SceneWorker | None = None
        self._request: HandoverRequest | None = None
        self._handover_checkpoint: Checkpoint | None = None
        self._lookup: VocabularyLookup | None = None
        self._reason: str | None = None
        fallen = scene.watch.fallen
        memory = next((file.beside("fall") for file in self._files.values()), None)
        self._falls = FallWatch(scene, service, fallen.after_s, memory, lambda: self.worker) if fallen else None

    @property
    def role(self) -> Role:
        """What this service does for the scene now."""
        return self.ownership.role

    def join(self) -> None:
        """Announce this service; those that are known now were there before it (rule 8 of fusion.md)."""
        self._session.poll()
        self._alive = self._services.alive
        self.ownership.set_alive(map(service_of, self._alive), self._service.ticks())
        self._session.announce(self.scene.keys.fusion_alive(self._service.own))

    def current(self, now_s: float) -> SceneWorker | None:
        """The worker of the next step, if any.

        The role is followed after each step, so that no listener waits for it; but first where there is no worker, or
        the last time is long ago: a service that was suspended must not publish before it has looked.
        """
        if self.worker is None or now_s - self._updated_s > STEPS_MISSED / self.scene.fusion.step_hz:
            self.update()
        return self.worker

    def update(self) -> None:
        """Take what other services have published, and follow the role that results."""
        now_s = self._updated_s = self._service.ticks()
        self._take_from_services(now_s)
        if self.worker is not None:
            self.worker.poll_requests()
        self._follow_vocabulary()
        self.ownership.update(now_s, lambda: self._is_connected(now_s))
        self._follow_same_id(now_s)
        if self._request is not None:
            self._request.poll()
            if self._request.finished:
                self.ownership.complete_handover()
        self._follow_role()
        if self._falls is not None:
            self._falls.step(self.role is Role.OWNER and self._same_id.stance is Stance.GO_ON)

    @property
    def at_rest(self) -> bool:
        """Whether no movement is in progress, as far as this service knows."""
        return self.worker is None or self.worker.at_rest

    def publish_status(self) -> None:
        """Publish the status of the service in this scene; to be called once a second."""
        if self.role is not Role.IDLE:
            self._status_publisher.publish()

    def close(self, fault: str = "") -> None:
        """Leave the scene. fault: why the service failed; "": it stops in order."""
        self._status_publisher.set_state("failed" if fault else "stopping", fault)
        for part in (self._falls, self.worker, self._listener, self._request, self._lookup, self._session):
            if part is not None:
                part.close()

    def _take_from_services(self, now_s: float) -> None:
        self._session.poll()
        if self._listener is not None:
            every = self._is_warm or self.role is Role.OWNER
            for message in self._listener.messages(now_s, self.vocabulary, every=every):
                if message is None:
                    self.ownership.record_heartbeat(now_s)
                elif message.fusion == self._service.own:
                    self._take_own(message, now_s)
                else:
                    self._take_judgement(message, now_s)
        if self._services.alive is not self._alive:
            # After their last messages, so that these do not bring back an owner that has gone.
            self._alive = self._services.alive
            self.ownership.set_alive(map(service_of, self._alive), now_s)

    def _take_judgement(self, message: JudgementMessage, now_s: float) -> None:
        """Take a message of another service: follow it, stand down for it, or continue its movement."""
        was_owner = self.role is Role.OWNER
        follows = self.ownership.record_message(message.fusion, message.epoch or 0, now_s)
        if self.worker is None:
            return
        if follows:
            if was_owner:
                self.worker.stand_down()
            self.worker.follow(message)
        elif was_owner and self.ownership.is_present(message.fusion):
            self.worker.adopt(message)

    def _take_own(self, message: JudgementMessage, now_s: float) -> None:
        """Take a message under this service's own id, as of another service if another process with it runs."""
        if self._same_id.record_judgement(message, now_s) and self.worker is not None:
            if self._same_id.stance is Stance.STAND_BY:
                self.worker.follow(message)
            elif self.role is Role.OWNER:
                self.worker.adopt(message)

    def _follow_same_id(self, now_s: float) -> None:
        """Stand by for another process with this id, or publish again; raises SameIdError in one that is to end."""
        before = self._same_id.stance
        self._id_is_shared = self._same_id.update(self.ownership.epoch if self.role is Role.OWNER else None, now_s)
        if self.worker is not None and self._same_id.stance is Stance.STAND_BY is not before:
            self.worker.stand_down()

    def _follow_vocabulary(self) -> None:
        """Follow the observers, or the owner, to another vocabulary; at rest take other durations of its movements."""
        if self.worker is None or self.vocabulary is None:
            return
        self._lookup = self._lookup or VocabularyLookup(self.scene, self._service, self.worker.present)
        wanted = None if self.scene.vocabulary is not None else self._wanted_vocabulary(self.worker)
        if wanted in (None, self.vocabulary.digest):
            times = self._lookup.times(self.vocabulary.digest)
            if times is not None and times != self.vocabulary.movements and self.worker.at_rest:
                self.vocabulary = replace(self.vocabulary, movements=times)
                self.worker.take_times(self.vocabulary)
            return
        vocabulary = self._lookup.poll(wanted)
        if vocabulary is not None:
            self._end_lookup()
            self.vocabulary = vocabulary
            self.worker.change_vocabulary(vocabulary)

    def _wanted_vocabulary(self, worker: SceneWorker) -> str | None:
        """The hash of the vocabulary in which the scene is to be fused now; None: as before."""
        if self.role is Role.OWNER:
            return worker.observed_vocabulary
        foreign = None if self._listener is None else self._listener.foreign
        follows = foreign is not None and self.ownership.owner in (None, foreign.fusion)
        return foreign.vocabulary.hash if foreign is not None and follows else None

    def _end_lookup(self) -> None:
        if self._lookup is not None:
            self._lookup.close()
            self._lookup = None

    def _is_connected(self, now_s: float) -> bool:
        """Whether this service can reach others: its link is connected, and posteriors of present observers arrive."""
        return self._service.link.connected and (self.worker is None or self.worker.is_receiving(now_s))

    def _follow_role(self) -> None:
        role, owner = self.role, self.ownership.owner
        if role is not Role.IDLE and self._listener is None:
            self._listener = StandbyListener(self.scene, self._service.link)
        elif role is Role.IDLE and self._listener is not None:
            self._listener.close()
            self._listener = None
        if role is Role.REQUESTING and self._request is None and owner is not None:
            self._request = HandoverRequest(self.scene, self._service.link, self._service.own, owner)
        fuses = role in (Role.OWNER, Role.REQUESTING) or (role is Role.STANDBY and self._is_warm)
        if fuses and self.worker is None:
            self._activate()
        elif not fuses and self.worker is not None and self.worker.reconcile():
            self.worker.close()
            self.worker = None
            self._end_lookup()
        if self.worker is not None:
            duty = self.worker.duty
            if role is Role.OWNER and not duty.restored:
                self._restore(self.worker)
            duty.owns = role is Role.OWNER and self._same_id.stance is Stance.GO_ON
            duty.fuses, duty.epoch = self._is_warm or role is Role.OWNER, self.ownership.epoch
            self.worker.reconcile()
        if role is not Role.REQUESTING and self._request is not None:
            self._request.close()
            self._request = None
        self._report()

    def _activate(self) -> None:
        if self.vocabulary is None:
            self._lookup = self._lookup or VocabularyLookup(self.scene, self._service)
            self.vocabulary = self._lookup.poll()
            if self.vocabulary is None:
                return
            self._end_lookup()
        self.worker = SceneWorker(
            self.scene, self._service, self._new_engine, self.vocabulary, self.status, self._files, self._hand_over
        )
        if self._is_warm and (checkpoint := self._read_files()) is not None:
            # Before the first posterior; after it the engine has a movement of its own.
            self.worker.restore(checkpoint)

    def _restore(self, worker: SceneWorker) -> None:
        """Continue from the newest checkpoint: an answer, the owner's last messages, the last handover, or the file."""
        asked = [part.checkpoint() for part in (self._request, self._listener) if part is not None]
        checkpoints = [*asked, self._handover_checkpoint, self._read_files()]
        worker.duty.restored = True
        if available := [checkpoint for checkpoint in checkpoints if checkpoint is not None]:
            # Of equally new ones the first: a handover has more than a judgement.
            worker.restore(max(available, key=lambda checkpoint: checkpoint.judgement.at_ns))

    def _read_files(self) -> Checkpoint | None:
        return Checkpoint.of_people(file.read(self.scene.scene) for file in self._files.values())

    def _hand_over(self, requester: str) -> bytes | None:
        if self.worker is None or not self.ownership.hand_over_to(requester, self._service.ticks()):
            return None
        self._handover_checkpoint = self.worker.checkpoint()
        log.info("%s: handed over to %s", self.scene.scene, requester)
        return b"" if self._handover_checkpoint is None else self._handover_checkpoint.to_json().encode()

    def _report(self) -> None:
        if self.role is Role.IDLE:
            self._reason = None
            return
        if self._id_is_shared:
            reason = SAME_ID_REASON
        elif self.role is Role.OWNER:
            reason = ASKING if self.worker is None else self.worker.complaint
        else:
            reason = f"{STANDING_BY} for {self.ownership.owner}" if self.ownership.owner else STANDING_BY
        if reason != self._reason:
            first, self._reason = self._reason is None, reason
            state: ProcessState = "degraded" if OVERLOADED in reason else "starting" if reason == ASKING else "running"
            self._status_publisher.set_state(state, reason)
            if reason or not first:
                level = logging.WARNING if state == "degraded" else logging.INFO
                log.log(level, "%s: %s", self.scene.scene, reason or "publishing")

    def _new_engine(self, vocabulary: Vocabulary, person: str | None) -> FusionEngine:
        config = self.scene.fusion.model_copy(update={"id": self._service.own})
        engine = FusionEngine(self.scene.scene, list(self.scene.roster), vocabulary, config, person)
        engine.session = self._service.session
        engine.wait_for_roster(config.start_s)
        return engine
