"""Judges a capture again offline, from its judgements or its posteriors, and compares the verdicts. Pure.

From posteriors, each group of arrivals is one step, with `step_hz` steps per second in between, as in the fusion
service. The exact times at which a service steps are not recorded, so it and the replay may decide a few milliseconds
apart; the replay itself always gives the same result.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, TypeVar

from common import SECOND_NS
from common.capture_record import APPEARED, GONE, CaptureRecord
from common.clock_skew import ClockReading
from common.errors import LabanmeshError
from common.keys import SceneKeys, observer_of
from common.message_fields import is_short
from common.messages import (
    JudgementMessage,
    Message,
    PosteriorMessage,
    StatusMessage,
    VerdictMessage,
    VocabularyMessage,
)
from common.vocabulary import Vocabulary
from common.wire import BadMessage, decode, decode_from, encode
from studies.fusion_engine import EngineOutput, FusionEngine
from studies.replay.comparison import ReplayResult, Source, VerdictRecord, compare_verdicts
from studies.replay.from_judgements import Gap, JudgementReplay, ReplayChange, Vocabularies, vocabulary_of

if TYPE_CHECKING:
    from common.capture_file import CaptureFile
    from common.config import Scene

Progress = Callable[[str, int, int], None]
EVERY = 500
VERDICTS_REPEATED = 10
"""A service sends at most this many verdicts again."""
GROUP_NS = 2_000_000
"""Arrivals within this time are one group: about as long as one step of the fusion service."""
DELAY_LIMIT_NS = 500_000_000
"""A status dated further from its arrival than this comes from a wrong clock."""
M = TypeVar("M", bound=Message)


def judge_again(
    capture: "CaptureFile", change: ReplayChange, source: Source | None = None, progress: Progress = lambda *_: None
) -> ReplayResult:
    """Judge `capture` again; source None: from its judgements if they have full votes, else from its posteriors.

    Raises BadInput for an impossible change, LabanmeshError for a capture without anything to judge.
    """
    change.check(capture.scene.roster)
    summary = _summarise(capture)
    change = change.in_place_of(summary.rule or capture.scene.fusion.rule)
    # Short votes are not exact; they are better than nothing.
    exact = summary.judgements and (summary.full or not summary.posteriors)
    if capture.scene.people.most > 1:
        raise LabanmeshError(f"{capture.path}: several people are judged in it, and only one can be judged again")
    chosen = source or ("judgements" if exact else "posteriors")
    if not (summary.judgements if chosen == "judgements" else summary.posteriors):
        raise LabanmeshError(f"{capture.path}: contains no {chosen}, so there is nothing to judge again")
    if chosen == "judgements":
        replayed = _from_judgements(capture, summary, change, progress)
        # The judgements of the last verdicts may be missing at the end of the capture.
        recorded = summary.verdicts[: len(summary.verdicts) - summary.after_last]
    else:
        outputs = replay_posteriors(capture.records(), capture.scene, summary.vocabularies, change)
        replayed = _Replayed(list(_verdict_records(outputs)), gaps=[Gap(0, summary.began_ns)])
        recorded = summary.verdicts
    return ReplayResult(
        source=chosen,
        change=change,
        rows=compare_verdicts(recorded, replayed.verdicts, replayed.gaps),
        records=summary.records,
        seconds=(summary.ended_ns - summary.began_ns) / SECOND_NS,
        began_ns=summary.began_ns,
        judgements=replayed.judgements if chosen == "judgements" else summary.judgements,
        same=replayed.same,
        missing=replayed.missing,
    )


@dataclass(slots=True)
class _CaptureSummary:
    """The contents of a capture. after_last: verdicts that follow the last judgement. full: whether all that is in the
    judgements is known: that there are some with full votes, or none with short ones. rule: of the first judgement.
    """

    vocabularies: dict[str, Vocabulary] = field(default_factory=dict)
    verdicts: list[VerdictRecord] = field(default_factory=list)
    records: int = 0
    judgements: int = 0
    posteriors: int = 0
    after_last: int = 0
    rule: str = ""
    full: bool = True
    began_ns: int = 0
    ended_ns: int = 0


@dataclass(frozen=True, slots=True)
class _Replayed:
    verdicts: list[VerdictRecord]
    judgements: int = 0
    same: int = 0
    missing: int = 0
    gaps: Sequence[Gap] = ()


def _summarise(capture: "CaptureFile") -> _CaptureSummary:
    keys, summary, has_votes = capture.scene.keys, _CaptureSummary(), False
    judged: dict[str, Vocabulary] = {}
    last = deque[bytes](maxlen=VERDICTS_REPEATED)
    for record in capture.records():
        summary.records += 1
        summary.began_ns = summary.began_ns or record.arrived_ns
        summary.ended_ns = max(summary.ended_ns, record.arrived_ns)
        if record.key == keys.vocabulary and (message := _decoded(VocabularyMessage, record)):
            # Answers are those of observers too, which may know other durations than those that are judged with first.
            is_judged = record.kind == "put" or message.fusion is not None
            judged = _vocabularies(message) | judged if is_judged else judged
            summary.vocabularies |= _vocabularies(message) | judged
        elif record.kind == "put":
            if record.key == keys.judgement:
                summary.judgements, summary.after_last = summary.judgements + 1, 0
                # One is enough to know, and to decode all takes long.
                judgement = _decoded(JudgementMessage, record) if summary.full else None
                summary.full = summary.full and not (judgement and is_short(judgement))
                summary.rule = summary.rule or (judgement.rule if judgement else "")
            has_votes = has_votes or record.key == keys.votes
            summary.posteriors += record.key.endswith("/posterior")
            # A verdict that is sent again, because it may have been lost, is no second one.
            is_verdict = record.key == keys.verdict and record.payload not in last
            if is_verdict and (verdict := _decoded(VerdictMessage, record)):
                last.append(record.payload)
                summary.verdicts.append(VerdictRecord(verdict, record.payload))
                summary.after_last += 1
    summary.full = summary.full or has_votes
    vocabulary = capture.scene.named_vocabulary
    if vocabulary is not None:
        summary.vocabularies.setdefault(vocabulary.digest, vocabulary)
    return summary


def _from_judgements(
    capture: "CaptureFile", summary: _CaptureSummary, change: ReplayChange, progress: Progress
) -> _Replayed:
    keys, same, number, verdicts = capture.scene.keys, 0, 0, list[VerdictRecord]()
    replay, last = JudgementReplay(capture.scene, summary.vocabularies, change), None
    for record in capture.records():
        if record.kind == "put" and record.key in (keys.judgement, keys.votes):
            judgement = _decoded(JudgementMessage, record)
            # The same judgement comes with full votes and with short ones.
            if judgement is None or _step(judgement) == last or (summary.full and is_short(judgement)):
                continue
            last, output = _step(judgement), replay.fuse(judgement)
            if output is not None:
                same += encode(output.judgement, full=not is_short(judgement)) == record.payload
                verdicts += _verdict_records([output])
            number += 1
            if number % EVERY == 0:
                progress("judging again", number, summary.judgements)
        elif record.kind == "put" and record.key == keys.vocabulary:
            if (message := _decoded(VocabularyMessage, record)) is not None:
                replay.set_times(message.vocabulary)
        elif record.key == keys.verdict and (verdict := _decoded(VerdictMessage, record)):
            replay.set_verdict(verdict)
        elif record.kind == "token" and record.payload == GONE and record.key.startswith(f"{keys.root}/fusion/"):
            replay.set_gone(observer_of(record.key))
    return _Replayed(verdicts, number, same, replay.missing, replay.gaps)


def _step(judgement: JudgementMessage) -> tuple[str, str | None, int]:
    """The key of a step."""
    return judgement.fusion, judgement.session, judgement.seq


def _verdict_records(outputs: Iterable[EngineOutput]) -> Iterator[VerdictRecord]:
    for output in outputs:
        for verdict in output.verdicts:
            yield VerdictRecord(verdict, encode(verdict))


def _vocabularies(message: VocabularyMessage) -> dict[str, Vocabulary]:
    try:
        return {message.hash: message.vocabulary}
    except LabanmeshError:
        return {}


def _decoded(kind: type[M], record: CaptureRecord) -> M | None:
    try:
        return decode(kind, record.payload)
    except BadMessage:
        return None


def replay_posteriors(
    records: Iterable[CaptureRecord], scene: "Scene", known: Vocabularies, change: ReplayChange
) -> Iterator[EngineOutput]:
    """The outputs of an engine that receives the captured posteriors when the capture did."""
    vocabulary = scene.named_vocabulary
    if vocabulary is None:
        vocabulary = replace(vocabulary_of(next(iter(known), "unknown"), known), name=scene.vocabulary_name)
    observers = change.remaining(scene.roster)
    config = change.config(scene.fusion, len(observers))
    engine = FusionEngine(scene.scene, list(observers), vocabulary, config)
    ingest = _CaptureIngest(scene.keys, engine)
    # After a longer silence nothing changes any more.
    quiet_ns = round((config.drop_s + 2 * config.hold_s + 1) * SECOND_NS)
    for group, now_ns in _groups(records, ingest.is_relevant, round(SECOND_NS / config.step_hz), quiet_ns):
        for record in group:
            ingest.add(record, now_ns)
        ended = [] if scene.named_vocabulary is not None else _follow(engine, known, now_ns)
        output = engine.step(now_ns)
        yield EngineOutput(output.judgement, [*ended, *output.verdicts]) if ended else output


def _follow(engine: FusionEngine, known: Vocabularies, now_ns: int) -> Sequence[VerdictMessage]:
    """Change to the vocabulary in which most observers publish, as the fusion service did; the verdicts that ended."""
    digest = engine.observed_vocabulary(now_ns)
    if digest is None or digest == engine.vocabulary.digest or digest not in known:
        return ()
    return engine.change_vocabulary(replace(vocabulary_of(digest, known), name=engine.vocabulary.name), now_ns)


class _CaptureIngest:
    """From captured bytes to the engine, as in the fusion service."""

    def __init__(self, keys: SceneKeys, engine: FusionEngine) -> None:
        self._keys, self._engine = keys, engine
        self._alive: frozenset[str] = frozenset()

    def is_relevant(self, record: CaptureRecord) -> bool:
        """Whether the record is a message or the liveliness token of an observer."""
        prefix = f"{self._keys.root}/observer/"
        same_depth = record.key.count("/") == prefix.count("/") + 1
        return record.kind != "answer" and record.key.startswith(prefix) and same_depth

    def add(self, record: CaptureRecord, now_ns: int) -> None:
        """Give one record to the engine; a message that cannot be decoded is counted and dropped."""
        observer, suffix = observer_of(record.key), record.key.rsplit("/", 1)[-1]
        try:
            if record.kind == "token":
                ids = frozenset({observer})
                self._alive = self._alive | ids if record.payload == APPEARED else self._alive - ids
                self._engine.set_present(self._alive)
            elif suffix == "posterior":
                message = decode_from(record.key, PosteriorMessage, record.payload)
                self._engine.receive(observer, message, now_ns)
            elif suffix == "status":
                self._read_clock(observer, decode(StatusMessage, record.payload), record.arrived_ns)
        except BadMessage as error:
            self._engine.reject(observer, error.reason)

    def _read_clock(self, observer: str, status: StatusMessage, arrived_ns: int) -> None:
        # The status was not requested, so its travel time is unknown: only a clearly wrong clock is corrected.
        if status.at_ns is not None and abs(status.at_ns - arrived_ns) > DELAY_LIMIT_NS:
            self._engine.record_clock(observer, ClockReading(arrived_ns, status.at_ns, arrived_ns))


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
