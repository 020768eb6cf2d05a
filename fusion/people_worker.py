"""Fuses one scene that judges several people: a `SceneWorker` for each person, and one session for all of them.

1. people.py says whose the tracks are; each person's posteriors go to the worker of that person, which judges as in a
   scene with one person.
2. The first person's worker always judges, so that listeners know that the service is there. Another one does while its
   person is there, and until the movement of a person who has left has ended.
3. A message of another service goes to the worker of its person. The places in it tell which of the people known here
   they are.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from common import SECOND_NS
from common.clock_skew import ClockQuerier
from common.config import Scene
from common.inbox import Arrival
from common.load import LoadMeter
from common.messages import JudgementMessage, VerdictMessage
from common.status import ProcessStatus
from common.vocabulary import Vocabulary
from common.wire import decode, encode_vocabulary
from fusion.checkpoint import Checkpoint, CheckpointFile, PeopleFiles
from fusion.engine.engine import FusionEngine
from fusion.engine.pooling import PooledPosterior, pool_steps
from fusion.ingest import NEWEST, newest
from fusion.people import ScenePeople
from fusion.people_ingest import PeopleIngest
from fusion.person_session import PersonSession
from fusion.scene_worker import RECEPTION_TIMEOUT_S, WAY_OUT, SceneWorker, Service, StepInput, StepResult

TOGETHER_S = 3.0
"""Who comes so long after the first posterior comes into a scene that runs: no observer is waited for."""


class NewEngine(Protocol):
    """Makes an engine in a vocabulary, for one of several people or for all that the scene has."""

    def __call__(self, vocabulary: Vocabulary, person: str | None = None) -> FusionEngine:
        """The engine."""


@dataclass(frozen=True, slots=True)
class PeopleInput(StepInput):
    """The first half of a step, of each person who is judged."""

    each: Sequence[tuple[SceneWorker, StepInput]] = ()


class PeopleWorker:
    """All that `SceneWorker` does, for the people of one scene."""

    def __init__(
        self,
        scene: Scene,
        service: Service,
        new_engine: NewEngine,
        vocabulary: Vocabulary,
        status: ProcessStatus,
        files: Mapping[str, CheckpointFile],
        hand_over: Callable[[str], bytes | None],
    ) -> None:
        """files: by person. hand_over: as for `SceneWorker`."""
        self._scene, self._service, self._status = scene, service, status
        self._clock, self._ticks = service.clock, service.ticks
        self._session = service.link.sub_session(polled=service.polled)
        self._requests = service.link.sub_session(polled=True)
        keys = scene.keys
        self._requests.answer_requests(
            keys.fusion_handover(service.own), lambda payload: hand_over(payload.decode("ascii", "replace"))
        )
        self.present = self._session.presence(keys.observer_alive(), map(keys.observer_alive, scene.roster))
        self._posteriors = self._session.inbox(*map(keys.posterior, scene.roster if service.polled else ()))
        self.people = ScenePeople(scene.people.ids)
        self._engines = {person: new_engine(vocabulary, person) for person in scene.people.ids}
        self._sessions = [PersonSession(self._session, self.present) for _ in self._engines]
        self._workers = {
            person: SceneWorker(scene, service, engine, status, files.get(person), hand_over, session)
            for (person, engine), session in zip(self._engines.items(), self._sessions, strict=True)
        }
        self._first = next(iter(self._workers.values()))
        first_engine = next(iter(self._engines.values()))
        self._ingest = PeopleIngest(self.people, scene.roster, first_engine.skew_s)
        status_keys = keys.observer_status()
        self._clocks = ClockQuerier(self._session, status_keys, service.clock, service.wake, service.ask_clocks_s)
        self._vocabulary = encode_vocabulary(scene.scene, vocabulary, service.own)
        self._session.answer(keys.vocabulary, lambda: self._vocabulary)
        self._session.answer(keys.judgement, lambda: self._answers(keys.judgement))
        self._session.answer(keys.verdict, lambda: self._verdict_answers(keys.verdict))
        self._received_s, self._load = service.ticks(), LoadMeter("posteriors", WAY_OUT)
        self._first_ns: int | None = None
        self.fuses = self.owns = self.restored = False
        self.epoch = 0

    @property
    def complaint(self) -> str:
        """As of `SceneWorker`."""
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
        arrivals = arrivals or self._posteriors.take(0)
        self._received_s = self._ticks() if arrivals else self._received_s
        read = newest(arrivals, NEWEST * len(self._workers))
        self._load.record(round(self._ticks() * SECOND_NS), len(arrivals) - len(read), len(read))
        now_ns = self._clock()
        if read and self._first_ns is None:
            self._first_ns = now_ns
        before = self.people.present
        of_person = self._ingest.sort(read, now_ns)
        self._welcome([person for person in self.people.present if person not in before], now_ns)
        each = []
        self._instruct()
        for person, worker in self._workers.items():
            own = of_person.get(person, [])
            if own or self._is_judged(person):
                place = self.people.place(person, now_ns)
                self._engines[person].place = None if place is None else [round(each, 2) for each in place]
                each.append((worker, worker.collect(own)))
        return PeopleInput(len(arrivals), len(read), now_ns, None, each)

    def finish(self, step: StepInput, pooled: PooledPosterior | None = None) -> StepResult:
        """Fuse what `collect` returned, and publish the results if this service owns the scene."""
        each = step.each if isinstance(step, PeopleInput) else ()
        self._instruct()
        pools = iter(pool_steps([own.case for _, own in each if own.case is not None]))
        results = [worker.finish(own, None if own.case is None else next(pools)) for worker, own in each]
        return StepResult(
            results[0].output if results else None, [verdict for result in results for verdict in result.published]
        )

    def read_clocks(self) -> None:
        """As of `SceneWorker`; what one reads is true for all."""
        if self._clocks.ask_if_due():
            # Of the first person's worker, which also counts what is of nobody.
            self._status.observers = self._first.statistics()
        for status, reading in self._clocks.readings():
            for engine in self._engines.values():
                engine.record_clock(status.id, reading)

    def is_receiving(self, now_s: float) -> bool:
        """Whether posteriors arrive, or no observer is present."""
        return not self.present.alive or now_s - self._received_s < RECEPTION_TIMEOUT_S

    def stand_down(self) -> None:
        """Stop publishing, because another service is the owner."""
        for worker in self._workers.values():
            worker.stand_down()

    def reconcile(self) -> bool:
        """As of `SceneWorker`: whether nothing is left to publish."""
        self._instruct()
        reconciled = [worker.reconcile() for worker in self._workers.values()]
        return all(reconciled)

    def adopt(self, message: JudgementMessage) -> None:
        """Continue a movement of a service that stands down."""
        self._worker_of(message).adopt(message)

    def follow(self, message: JudgementMessage) -> None:
        """Continue from the owner's message."""
        self._align([message])
        self._worker_of(message).follow(message)
        self.restored = True

    @property
    def observed_vocabulary(self) -> str | None:
        """As of `SceneWorker`: in which the observers of most people publish, of those for whom there is a majority."""
        known = [worker.observed_vocabulary for worker in self._workers.values()]
        return max(filter(None, known), key=known.count, default=None)

    def change_vocabulary(self, vocabulary: Vocabulary) -> None:
        """Fuse posteriors in `vocabulary` from now on."""
        self._instruct()
        self._vocabulary = encode_vocabulary(self._scene.scene, vocabulary, self._service.own)
        for worker in self._workers.values():
            worker.change_vocabulary(vocabulary)

    def take_times(self, vocabulary: Vocabulary) -> None:
        """Take the durations of the same movements in `vocabulary`."""
        self._vocabulary = encode_vocabulary(self._scene.scene, vocabulary, self._service.own)
        for worker in self._workers.values():
            worker.take_times(vocabulary)

    def checkpoint(self) -> Checkpoint | None:
        """What another service needs to continue: the checkpoints of all people."""
        known = [each for worker in self._workers.values() if (each := worker.checkpoint()) is not None]
        return known[0].model_copy(update={"people": tuple(known[1:])}) if known else None

    def restore(self, checkpoint: Checkpoint) -> None:
        """Continue from `checkpoint`."""
        each = [checkpoint.model_copy(update={"people": ()}), *checkpoint.people]
        self._align([one.judgement for one in each])
        for one in each:
            self._worker_of(one.judgement).restore(one)
        self.restored = True

    def close(self) -> None:
        """End all subscriptions and publications."""
        for worker in self._workers.values():
            worker.close()
        self._requests.close()
        self._session.close()

    def _is_judged(self, person: str) -> bool:
        worker = self._workers[person]
        return worker is self._first or person in self.people.present or not worker.at_rest

    def _instruct(self) -> None:
        """What the scene's membership has set is true for each worker."""
        for worker in self._workers.values():
            worker.fuses, worker.owns, worker.epoch = self.fuses, self.owns, self.epoch

    def _welcome(self, coming: Sequence[str], now_ns: int) -> None:
        """Wait for no observer where somebody comes into a scene that runs: not all of them need to see that person."""
        if self._first_ns is not None and abs(now_ns - self._first_ns) > TOGETHER_S * SECOND_NS:
            for person in coming:
                self._engines[person].wait_for_roster(0)

    def _worker_of(self, message: JudgementMessage) -> SceneWorker:
        return self._workers.get(message.person or "", self._first)

    def _align(self, messages: Sequence[JudgementMessage]) -> None:
        """Call the people here as the owner does."""
        places = {each.person: each.place for each in messages if each.person is not None and each.place is not None}
        if places:
            self.people.align(places, self._clock())

    def _answers(self, key: str) -> list[bytes]:
        """What the workers answer to a query under `key`."""
        answers = []
        for session in self._sessions:
            payloads = session.answers[key]()
            answers += [payloads] if isinstance(payloads, bytes) else list(payloads or ())
        return answers

    def _verdict_answers(self, key: str) -> list[bytes]:
        """Those of all people, the newest last."""
        return sorted(self._answers(key), key=lambda payload: decode(VerdictMessage, payload).at_ns)


Worker = SceneWorker | PeopleWorker


def people_of(worker: Worker | None) -> ScenePeople | None:
    """Who is who in a scene that judges several people; None while nobody judges it here."""
    return worker.people if isinstance(worker, PeopleWorker) else None


def worker_of(
    scene: Scene,
    service: Service,
    new_engine: NewEngine,
    vocabulary: Vocabulary,
    status: ProcessStatus,
    file: CheckpointFile | PeopleFiles | None,
    hand_over: Callable[[str], bytes | None],
) -> Worker:
    """The worker of a scene, for one person or for several."""
    if scene.people.most > 1:
        files = file.files if isinstance(file, PeopleFiles) else {}
        return PeopleWorker(scene, service, new_engine, vocabulary, status, files, hand_over)
    own = file if isinstance(file, CheckpointFile) else None
    return SceneWorker(scene, service, new_engine(vocabulary), status, own, hand_over)
