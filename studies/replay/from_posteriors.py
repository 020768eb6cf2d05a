"""Judges a capture again from its posteriors. Pure.

Each group of arrivals is one step, with `step_hz` steps per second in between, as in the fusion service. The exact
times at which a service steps are not recorded, so it and the replay may decide a few milliseconds apart; the replay
itself always gives the same result. Of several people each has an engine, as in the service.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from common import SECOND_NS
from common.arrival import Arrival
from common.capture_record import APPEARED, CaptureRecord
from common.clock_skew import ClockReading
from common.keys import observer_of
from common.messages import ObserverPosterior, PosteriorMessage, StatusMessage, VerdictMessage
from common.wire import BadMessage, decode, decode_from
from studies.fusion_engine import EngineOutput, FusionEngine, PeopleIngest, ScenePeople
from studies.replay.from_judgements import ReplayChange, Vocabularies, vocabulary_of

if TYPE_CHECKING:
    from common.config import Scene

GROUP_NS = 2_000_000
"""Arrivals within this time are one group: about as long as one step of the fusion service."""
DELAY_LIMIT_NS = 500_000_000
"""A status dated further from its arrival than this comes from a wrong clock."""


def replay_posteriors(
    records: Iterable[CaptureRecord], scene: "Scene", known: Vocabularies, change: ReplayChange
) -> Iterator[EngineOutput]:
    """The outputs of an engine that receives the captured posteriors when the capture did."""
    vocabulary = scene.named_vocabulary
    if vocabulary is None:
        vocabulary = replace(vocabulary_of(next(iter(known), "unknown"), known), name=scene.vocabulary_name)
    observers = change.remaining(scene.roster)
    config = change.config(scene.fusion, len(observers))
    people = scene.people.ids if scene.people.most > 1 else (None,)
    engines = [FusionEngine(scene.scene, list(observers), vocabulary, config, person) for person in people]
    ingest = _CaptureIngest(scene, observers, dict(zip(people, engines, strict=True)))
    # After a longer silence nothing changes any more.
    quiet_ns = round((config.drop_s + 2 * config.hold_s + 1) * SECOND_NS)
    for group, now_ns in _groups(records, ingest.is_relevant, round(SECOND_NS / config.step_hz), quiet_ns):
        ingest.add(group, now_ns)
        for engine in engines:
            ended = [] if scene.named_vocabulary is not None else _follow(engine, known, now_ns)
            output = engine.step(now_ns)
            yield EngineOutput(output.judgement, [*ended, *output.verdicts]) if ended else output


def _follow(engine: FusionEngine, known: Vocabularies, now_ns: int) -> Sequence[VerdictMessage]:
    """Change to the vocabulary in which most observers publish, as the fusion service did; the verdicts that ended."""
    digest = engine.roster.majority(now_ns)
    if digest is None or digest == engine.vocabulary.digest or digest not in known:
        return ()
    return engine.change_vocabulary(replace(vocabulary_of(digest, known), name=engine.vocabulary.name), now_ns)


class _CaptureIngest:
    """From captured bytes to the engines, by person, as in the fusion service."""

    def __init__(self, scene: "Scene", observers: Sequence[str], engines: Mapping[str | None, FusionEngine]) -> None:
        self._keys, self._engines, self._first = scene.keys, engines, next(iter(engines.values()))
        self._people: PeopleIngest | None = None
        if scene.people.most > 1:
            self._people = PeopleIngest(ScenePeople(scene.people.ids), self._first.roster.skew_s)
        self._alive: frozenset[str] = frozenset()

    def is_relevant(self, record: CaptureRecord) -> bool:
        """Whether the record is a message or the liveliness token of an observer."""
        prefix = f"{self._keys.root}/observer/"
        same_depth = record.key.count("/") == prefix.count("/") + 1
        return record.kind != "answer" and record.key.startswith(prefix) and same_depth

    def add(self, group: Sequence[CaptureRecord], now_ns: int) -> None:
        """Give the records to the engines in order; a message that cannot be decoded is counted and dropped."""
        arrivals: list[Arrival] = []
        for record in group:
            if record.key.endswith("/posterior") and record.kind != "token":
                arrivals.append(Arrival(record.key, record.payload, record.arrived_ns))
                continue
            self._receive(arrivals, now_ns)
            arrivals, observer = [], observer_of(record.key)
            if record.kind == "token":
                ids = frozenset({observer})
                self._alive = self._alive | ids if record.payload == APPEARED else self._alive - ids
                for engine in self._engines.values():
                    engine.roster.set_present(self._alive)
            elif record.key.endswith("/status"):
                self._read_clock(observer, record)
        self._receive(arrivals, now_ns)

    def _receive(self, arrivals: Sequence[Arrival], now_ns: int) -> None:
        posteriors = self._decoded(arrivals)
        of_person: Iterable[tuple[str | None, Iterable[ObserverPosterior]]] = [(None, posteriors)]
        if self._people is not None:
            of_person = self._people.sort(posteriors, now_ns).items()
        for person, own in of_person:
            for observer, message in own:
                self._engines[person].receive(observer, message, now_ns)

    def _decoded(self, arrivals: Iterable[Arrival]) -> Iterator[ObserverPosterior]:
        for arrival in arrivals:
            observer = observer_of(arrival.key)
            try:
                message = decode_from(arrival.key, PosteriorMessage, arrival.payload)
            except BadMessage as error:
                self._first.roster.reject(observer, error.reason)
                continue
            if observer in self._first.roster.rejected:
                yield observer, message

    def _read_clock(self, observer: str, record: CaptureRecord) -> None:
        # The status was not requested, so its travel time is unknown: only a clearly wrong clock is corrected.
        try:
            status = decode(StatusMessage, record.payload)
        except BadMessage as error:
            self._first.roster.reject(observer, error.reason)
            return
        if status.at_ns is not None and abs(status.at_ns - record.arrived_ns) > DELAY_LIMIT_NS:
            for engine in self._engines.values():
                engine.roster.record_clock(observer, ClockReading(record.arrived_ns, status.at_ns, record.arrived_ns))


def _groups(
    records: Iterable[CaptureRecord], is_relevant: Callable[[CaptureRecord], bool], step_ns: int, quiet_ns: int
) -> Iterator[tuple[list[CaptureRecord], int]]:
    """The records of each step, and the time of the step."""
    group: list[CaptureRecord] = []
    last_ns: int | None = None
    for record in records:
        now_ns = record.arrived_ns
        if group and not 0 <= now_ns - group[0].arrived_ns <= GROUP_NS:
            last_ns = group[-1].arrived_ns
            yield group, last_ns
            group = []
        if not group and last_ns is not None:
            for idle_ns in range(last_ns + step_ns, min(now_ns, last_ns + quiet_ns), step_ns):
                last_ns = idle_ns
                yield [], idle_ns
        if is_relevant(record):
            group.append(record)
    if group:
        yield group, group[-1].arrived_ns
