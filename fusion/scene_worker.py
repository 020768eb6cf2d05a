"""Fuses one scene in this process: posteriors in, judgements and verdicts out, for one person or for several.

1. A scene has one session, and a `PersonWorker` for each person, which judges. people.py says whose the tracks are.
2. The first person's worker always judges, so that listeners know that the service is there. Another one does while its
   person is there, and until the movement of a person who has left has ended.
3. A message of another service goes to the worker of its person. The places in it tell which of the people known here
   they are.
"""

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from common import SECOND_NS
from common.clock_skew import ClockQuerier
from common.config import Scene
from common.inbox import Arrival, Inbox, NewestMessages
from common.load import LoadMeter
from common.messages import JudgementMessage, ObserverPosterior, VerdictMessage
from common.status import ProcessStatus
from common.vocabulary import Vocabulary
from common.wire import decode, encode_vocabulary
from fusion.checkpoint import Checkpoint, CheckpointFile
from fusion.engine.engine import FusionEngine
from fusion.engine.pooling import PooledPosterior, PoolingCase
from fusion.ingest import NEWEST, PosteriorIngest, newest
from fusion.people import ScenePeople
from fusion.people_ingest import PeopleIngest
from fusion.person_worker import Duty, PersonWorker
from fusion.reconciliation import Reachability
from fusion.service import Service

log = logging.getLogger("labanmesh.fusion")
OVERLOAD_WAY_OUT = "find out who sends so many (labanmesh doctor), or run fuse on a faster machine"
SCENES_WAY_OUT = "share the scenes with a second fuse, on another machine or core, under another --id"
RECEPTION_TIMEOUT_S = 0.3
"""A service that has received no posterior for so long is disconnected itself, rather than the owner silent."""
TOGETHER_S = 3.0
"""Who comes so long after the first posterior comes into a scene that runs: no observer is waited for."""


@dataclass(frozen=True, slots=True)
class StepInput:
    """The first half of a step: how many posteriors were received and read; of each person who is judged the time, and
    the case to pool."""

    received: int = 0
    read: int = 0
    each: Sequence[tuple[PersonWorker, int, PoolingCase]] = ()

    @property
    def cases(self) -> list[PoolingCase]:
        """The cases to pool."""
        return [case for _, _, case in self.each]


class SceneWorker:
    """The engines of a scene with its subscriptions and publications, which end with `close`.

    duty: what the service does for the scene. present: the observers that are. people: who is who in a scene that
    judges several people.
    """

    def __init__(
        self,
        scene: Scene,
        service: Service,
        new_engine: Callable[[Vocabulary, str | None], FusionEngine],
        vocabulary: Vocabulary,
        status: ProcessStatus,
        files: Mapping[str | None, CheckpointFile],
        hand_over: Callable[[str], bytes | None],
    ) -> None:
        """new_engine: makes the engine of a person; None: of the only one. hand_over: called between two steps with the
        id of a service that asks for the scene.
        """
        self._scene, self._service, self._status, keys = scene, service, status, scene.keys
        self.duty, self._reachable = Duty(), Reachability()
        self._session = service.link.sub_session(polled=service.polled)
        # Always polled: ownership changes between two steps only.
        self._requests = service.link.sub_session(polled=True)
        self._posteriors = self._subscribed()
        self.present = self._session.presence(keys.observer_alive(), map(keys.observer_alive, scene.roster))
        self._workers: Mapping[str | None, PersonWorker] = {
            person: PersonWorker(
                scene, service, new_engine(vocabulary, person), status, files.get(person), self._session, self.duty,
                self._is_reachable,
            )
            for person in scene.people.judged
        }  # fmt: skip
        self._first = next(iter(self._workers.values()))
        self.people = ScenePeople(scene.people.ids) if scene.people.most > 1 else None
        self._ingest = PosteriorIngest(self._first.engine)
        self._by_person = None if self.people is None else PeopleIngest(self.people, self._first.engine.roster.skew_s)
        status_keys, every_s = keys.observer_status(), service.ask_clocks_s
        self._clocks = ClockQuerier(self._session, status_keys, service.clock, service.wake, every_s)
        self._vocabulary = encode_vocabulary(scene.scene, vocabulary, service.own)
        self._answer(hand_over)
        self._keeps_newest = service.polled and scene.people.most == 1
        way_out = SCENES_WAY_OUT if self._keeps_newest else OVERLOAD_WAY_OUT
        self._received_s, self._load = service.ticks(), LoadMeter("posteriors", way_out)
        self._stepped_s = self._received_s
        self._first_ns: int | None = None

    def _subscribed(self) -> Inbox | NewestMessages:
        """What receives posteriors of many scenes; with few scenes the server has one inbox."""
        # By whole keys: with 250 wildcards, which Zenoh tries one by one, a message costs ten times as much.
        names = [*map(self._scene.keys.posterior, self._scene.roster)] if self._service.polled else ()
        return self._session.newest(*names) if self._scene.people.most == 1 else self._session.inbox(*names)

    def _answer(self, hand_over: Callable[[str], bytes | None]) -> None:
        """Answer late joiners, and services that ask for the scene."""
        keys = self._scene.keys
        self._requests.answer_requests(
            keys.fusion_handover(self._service.own), lambda payload: hand_over(payload.decode("ascii", "replace"))
        )
        self._session.answer(keys.vocabulary, lambda: self._vocabulary)
        self._session.answer(keys.judgement, self._last_judgements)
        self._session.answer(keys.verdict, self._last_verdicts)

    @property
    def complaint(self) -> str:
        """That more posteriors arrive than can be read, and what to do; "" if all is well."""
        return self._load.complaint

    @property
    def at_rest(self) -> bool:
        """Whether no movement of anybody is in progress."""
        return all(worker.at_rest for worker in self._workers.values())

    def poll_requests(self) -> None:
        """Answer a handover request, if one has arrived."""
        self._requests.poll()

    def collect(self, arrivals: Sequence[Arrival] = ()) -> StepInput:
        """Receive `arrivals` and everything else that has arrived; the result has the cases of all people."""
        self._session.poll()
        arrivals = arrivals or self._posteriors.take()
        now_s = self._service.ticks()
        self._received_s = now_s if arrivals else self._received_s
        read = newest(arrivals, NEWEST * len(self._workers))
        missed = len(arrivals) - len(read) + self._replaced(now_s) * len(read)
        self._load.record(round(now_s * SECOND_NS), missed, len(read))
        posteriors = self._ingest.read(read, self._service.clock())
        of_people = {} if self._by_person is None else self._sorted(self._by_person, list(posteriors))
        each = []
        for person, worker in self._workers.items():
            own = posteriors if person is None else of_people.get(person, ())
            if own or self._is_judged(person):
                now_ns, case = worker.collect(own, self._ingest, self.present)
                if case is not None:
                    each.append((worker, now_ns, case))
        return StepInput(len(arrivals), len(read), each)

    def _replaced(self, now_s: float) -> int:
        """How many posteriors of each observer newer ones have replaced since the last step, because it is late."""
        late_s, self._stepped_s = now_s - self._stepped_s, now_s
        return max(0, round(late_s * self._scene.fusion.step_hz) - 1) if self._keeps_newest else 0

    def finish(self, step: StepInput, pools: Iterator[PooledPosterior]) -> list[VerdictMessage]:
        """Fuse what `collect` returned, and publish the results if this service owns the scene; the verdicts published.

        pools: the next ones are the pooled posteriors of the step's cases.
        """
        return [
            verdict
            for (worker, now_ns, case), pooled in zip(step.each, pools, strict=False)
            for verdict in worker.finish(now_ns, case, pooled, self._vocabulary)
        ]

    @property
    def judgement(self) -> JudgementMessage | None:
        """The last one on the first person."""
        return self._first.judgement

    def read_clocks(self) -> None:
        """Ask for the observers' clocks if it is due, and take the answers; after a step, when no listener waits."""
        if self._clocks.ask_if_due():
            self._status.observers = self._ingest.statistics(self._scene.roster)
        for status, reading in self._clocks.readings():
            for worker in self._workers.values():
                worker.engine.roster.record_clock(status.id, reading)

    def _is_reachable(self) -> bool:
        return self._scene.mesh.mode != "router" or self._reachable.update(
            self._service.link.connected, self._received_s, self._service.ticks()
        )

    def is_receiving(self, now_s: float) -> bool:
        """Whether posteriors arrive, or no observer is present."""
        return not self.present.alive or now_s - self._received_s < RECEPTION_TIMEOUT_S

    def stand_down(self) -> None:
        """Stop publishing, because another service is the owner."""
        for worker in self._workers.values():
            worker.stand_down()

    def reconcile(self) -> bool:
        """Publish what is left of the time when this service was the owner, and verdicts that may be lost. Returns
        whether nothing is left to publish; to be called at every step.
        """
        is_reachable = self._is_reachable()
        lost_from_s = self._reachable.lost_from(self._service.ticks())
        doubtful_from_s = self._reachable.doubtful_from_s
        reconciled = [worker.reconcile(lost_from_s, doubtful_from_s) for worker in self._workers.values()]
        return is_reachable and all(reconciled)

    def adopt(self, message: JudgementMessage) -> None:
        """Continue a movement of a service that stands down."""
        self._worker_of(message).adopt(message)

    def follow(self, message: JudgementMessage) -> None:
        """Continue from the owner's message."""
        self._align([message])
        self._worker_of(message).follow(message)

    @property
    def observed_vocabulary(self) -> str | None:
        """The hash of the vocabulary in which the observers of most people publish; None if there is no majority."""
        now_ns = self._service.clock()
        known = [worker.engine.roster.majority(now_ns) for worker in self._workers.values()]
        return max(filter(None, known), key=known.count, default=None)

    def change_vocabulary(self, vocabulary: Vocabulary) -> None:
        """Fuse posteriors in `vocabulary` from now on."""
        self._vocabulary = encode_vocabulary(self._scene.scene, vocabulary, self._service.own)
        for worker in self._workers.values():
            worker.change_vocabulary(vocabulary, self._vocabulary)
        log.info("%s: new vocabulary: %s", self._scene.scene, ", ".join(vocabulary.labels))

    def take_times(self, vocabulary: Vocabulary) -> None:
        """Take the durations of the same movements in `vocabulary`; the owner publishes them with the next step."""
        self._vocabulary = encode_vocabulary(self._scene.scene, vocabulary, self._service.own)
        for worker in self._workers.values():
            worker.engine.take_times(vocabulary)

    def checkpoint(self) -> Checkpoint | None:
        """What another service needs to continue: the checkpoints of all people."""
        return Checkpoint.of_people(worker.publisher.checkpoint() for worker in self._workers.values())

    def restore(self, checkpoint: Checkpoint) -> None:
        """Continue from `checkpoint`."""
        each = [checkpoint.model_copy(update={"people": ()}), *checkpoint.people]
        self._align([one.judgement for one in each])
        for one in each:
            self._worker_of(one.judgement).restore(one)
        self.duty.restored = True

    def close(self) -> None:
        """End all subscriptions and publications."""
        self._requests.close()
        self._session.close()

    def _sorted(
        self, ingest: PeopleIngest, posteriors: Sequence[ObserverPosterior]
    ) -> Mapping[str, Sequence[ObserverPosterior]]:
        """The posteriors by person, each of whom is told where they are."""
        now_ns, before = self._service.clock(), ingest.people.present
        if posteriors and self._first_ns is None:
            self._first_ns = now_ns
        result = ingest.sort(posteriors, now_ns)
        for each in ingest.people.present:
            # Not all observers need to see somebody who comes into a scene that runs.
            if each not in before and abs(now_ns - (self._first_ns or now_ns)) > TOGETHER_S * SECOND_NS:
                self._workers[each].engine.wait_for_roster(0)
        for person, worker in self._workers.items():
            place = None if person is None else ingest.people.place(person, now_ns)
            worker.engine.place = None if place is None else [round(metres, 2) for metres in place]
        return result

    def _is_judged(self, person: str | None) -> bool:
        worker = self._workers[person]
        return worker is self._first or self.people is None or person in self.people.present or not worker.at_rest

    def _worker_of(self, message: JudgementMessage) -> PersonWorker:
        return self._workers.get(message.person, self._first)

    def _align(self, messages: Sequence[JudgementMessage]) -> None:
        """Call the people here as the owner does."""
        places = {each.person: each.place for each in messages if each.person is not None and each.place is not None}
        if places and self.people is not None:
            self.people.align(places, self._service.clock())

    def _last_judgements(self) -> list[bytes]:
        """Of each person; the owner alone has them for late joiners."""
        payloads = [worker.publisher.judgement_payload for worker in self._workers.values() if self.duty.owns]
        return [payload for payload in payloads if payload is not None]

    def _last_verdicts(self) -> list[bytes]:
        """Those of all people, the newest last; the owner alone has them for late joiners."""
        payloads = [
            payload
            for worker in self._workers.values()
            if self.duty.owns
            for payload in worker.publisher.verdict_payloads
        ]
        return sorted(payloads, key=lambda payload: decode(VerdictMessage, payload).at_ns) if self.people else payloads
