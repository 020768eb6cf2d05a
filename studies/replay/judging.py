"""Judges a capture again offline and compares each verdict with the recorded one. Pure."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

from common.capture_file import APPEARED, GONE, CaptureRecord
from common.clock_skew import ClockReading
from common.errors import LabanmeshError
from common.keys import SceneKeys, observer_of
from common.messages import (
    JudgementMessage,
    Message,
    PosteriorMessage,
    StatusMessage,
    VerdictMessage,
    VocabularyMessage,
)
from common.vocabulary import Vocabulary
from common.wire import BadMessage, decode, encode
from fusion.engine.engine import EngineOutput, FusionEngine
from studies.replay.comparison import Replayed, Saying, Source, rows_of
from studies.replay.from_judgements import Change, FromJudgements, labels_of

if TYPE_CHECKING:
    from common.capture_file import CaptureFile
    from common.config import Scene
    from common.keys import SceneKeys

Progress = Callable[[str, int, int], None]
EVERY = 500
M = TypeVar("M", bound=Message)


def judge_anew(
    capture: "CaptureFile", change: Change, source: Source | None = None, progress: Progress = lambda *_: None
) -> Replayed:
    """Judge `capture` anew; source None: from its judgements if it has any, else from its posteriors.

    Raises BadInput for a change that cannot be, LabanmeshError for a capture that holds nothing to judge.
    """
    change.check(capture.scene.roster)
    first = _look(capture)
    chosen = source or ("judgements" if first.judgements else "posteriors")
    if not (first.judgements if chosen == "judgements" else first.posteriors):
        raise LabanmeshError(f"{capture.path}: no {chosen} in it, so that there is nothing to judge anew")
    anew = _again(capture, first, change, progress) if chosen == "judgements" else _afresh(capture, first, change)
    # The last verdicts may be of a judgement that the capture did not live to hear.
    heard = len(first.verdicts) - (first.after_all if chosen == "judgements" else 0)
    rows = rows_of(first.verdicts[:heard], anew.verdicts, anew.unsure)
    return Replayed(
        source=chosen,
        change=change,
        rows=rows,
        records=first.records,
        seconds=(first.ended_ns - first.began_ns) / 1e9,
        began_ns=first.began_ns,
        judgements=first.judgements,
        same=anew.same,
        missing=anew.missing,
    )


@dataclass(slots=True)
class _Look:
    """What there is in a capture; `after_all`: so many of the verdicts came after the last judgement."""

    labels: dict[str, tuple[str, ...]]
    verdicts: list[Saying]
    records: int = 0
    judgements: int = 0
    posteriors: int = 0
    after_all: int = 0
    began_ns: int = 0
    ended_ns: int = 0


@dataclass(frozen=True, slots=True)
class _Anew:
    verdicts: list[Saying]
    same: int = 0
    missing: int = 0
    unsure: Sequence[tuple[int, int]] = ()


def _look(capture: "CaptureFile") -> _Look:
    keys, found = capture.scene.keys, _Look({}, [])
    for record in capture.records():
        found.records += 1
        found.began_ns = found.began_ns or record.arrived_ns
        found.ended_ns = max(found.ended_ns, record.arrived_ns)
        if record.key == keys.vocabulary and (told := _readable(VocabularyMessage, record)):
            found.labels |= _usable(told)
        elif record.kind == "put":
            if record.key == keys.judgement:
                found.judgements, found.after_all = found.judgements + 1, 0
            found.posteriors += record.key.endswith("/posterior")
            if record.key == keys.verdict and (verdict := _readable(VerdictMessage, record)):
                found.verdicts.append(Saying(verdict, record.payload))
                found.after_all += 1
    named = capture.scene.named_vocabulary
    return found if named is None else _with(found, named)


def _with(found: _Look, named: Vocabulary) -> _Look:
    found.labels.setdefault(named.digest, named.labels)
    return found


def _again(capture: "CaptureFile", first: _Look, change: Change, progress: Progress) -> _Anew:
    """From the judgements: each is ruled on again and compared."""
    keys, same, number, said = capture.scene.keys, 0, 0, list[Saying]()
    court = FromJudgements(capture.scene, first.labels, change)
    for record in capture.records():
        if record.key == keys.judgement and record.kind == "put":
            judgement = _readable(JudgementMessage, record)
            ruling = None if judgement is None else court.rule_on(judgement)
            if ruling is not None:
                same += encode(ruling.judgement) == record.payload
                said += _sayings([ruling])
            number += 1
            if number % EVERY == 0:
                progress("judging anew", number, first.judgements)
        elif record.key == keys.verdict and (verdict := _readable(VerdictMessage, record)):
            court.remember(verdict)
        elif _is_gone(record, keys):
            court.gone(observer_of(record.key))
    return _Anew(said, same, court.missing, court.unsure)


def _afresh(capture: "CaptureFile", first: _Look, change: Change) -> _Anew:
    rulings = from_posteriors(capture.records(), capture.scene, first.labels, change)
    return _Anew(list(_sayings(rulings)), unsure=[(0, first.began_ns)])


def _sayings(rulings: Iterable[EngineOutput]) -> Iterator[Saying]:
    for ruling in rulings:
        for verdict in ruling.verdicts:
            yield Saying(verdict, encode(verdict))


def _is_gone(record: CaptureRecord, keys: "SceneKeys") -> bool:
    return record.kind == "token" and record.payload == GONE and record.key.startswith(f"{keys.root}/fusion/")


def _usable(told: VocabularyMessage) -> dict[str, tuple[str, ...]]:
    try:
        vocabulary = Vocabulary(tuple(told.labels), told.name)
    except LabanmeshError:
        return {}
    return {vocabulary.digest: vocabulary.labels}


def _readable(kind: type[M], record: CaptureRecord) -> M | None:
    try:
        return decode(kind, record.payload)
    except BadMessage:
        return None


SECOND_NS = 1_000_000_000
LOT_NS = 2_000_000
"""What arrives within this time is one lot: about as long as the referee takes for a step."""
UNDER_WAY_NS = 500_000_000
"""A status that is dated further from its arrival than this was said by a clock that is wrong."""


def from_posteriors(
    records: Iterable[CaptureRecord], scene: "Scene", labels: Mapping[str, tuple[str, ...]], change: Change
) -> Iterator[EngineOutput]:
    """The captured posteriors as the referee would judge them that hears them when the capture did."""
    vocabulary = scene.named_vocabulary or Vocabulary(_only(labels), scene.vocabulary_name)
    observers = change.remaining(scene.roster)
    conduct = change.conduct(scene.fusion, len(observers))
    referee = FusionEngine(scene.scene, list(observers), vocabulary, conduct)
    ear = _Ear(scene.keys, referee)
    # Longer silence than this changes nothing any more.
    quiet_ns = round((conduct.drop_s + 2 * conduct.hold_s + 1) * SECOND_NS)
    for lot, now_ns in _lots(records, ear.concerns, round(SECOND_NS / conduct.step_hz), quiet_ns):
        for record in lot:
            ear.hear(record, now_ns)
        yield referee.step(now_ns)


class _Ear:
    """From captured bytes to the referee, as the fusion service does it."""

    def __init__(self, keys: SceneKeys, referee: FusionEngine) -> None:
        self._keys, self._referee = keys, referee
        self._alive: frozenset[str] = frozenset()

    def concerns(self, record: CaptureRecord) -> bool:
        """Whether this is something that an observer said, or he himself."""
        below = f"{self._keys.root}/observer/"
        return (
            record.kind != "answer" and record.key.startswith(below) and record.key.count("/") == below.count("/") + 1
        )

    def hear(self, record: CaptureRecord, now_ns: int) -> None:
        """One record; a bad one is counted and dropped."""
        observer, what = observer_of(record.key), record.key.rsplit("/", 1)[-1]
        try:
            if record.kind == "token":
                ids = frozenset({observer})
                self._alive = self._alive | ids if record.payload == APPEARED else self._alive - ids
                self._referee.set_present(self._alive)
            elif what == "posterior":
                self._hear_posterior(observer, decode(PosteriorMessage, record.payload), now_ns)
            elif what == "status":
                self._read_clock(observer, decode(StatusMessage, record.payload), record.arrived_ns)
        except BadMessage as error:
            self._referee.reject(observer, error.reason)

    def _hear_posterior(self, observer: str, message: PosteriorMessage, now_ns: int) -> None:
        if message.is_of(self._keys.scene, observer):
            self._referee.receive(observer, message, now_ns)
        else:
            self._referee.reject(observer, "wrong_key")

    def _read_clock(self, observer: str, status: StatusMessage, arrived_ns: int) -> None:
        # Nobody was asked: how long a status was under way is not known, so only a plainly wrong clock is one.
        if status.at_ns is not None and abs(status.at_ns - arrived_ns) > UNDER_WAY_NS:
            self._referee.record_clock(observer, ClockReading(arrived_ns, status.at_ns, arrived_ns))


def _lots(
    records: Iterable[CaptureRecord], concerns: Callable[[CaptureRecord], bool], step_ns: int, quiet_ns: int
) -> Iterator[tuple[list[CaptureRecord], int]]:
    """What is heard in each step, and when that is (rule 3)."""
    lot: list[CaptureRecord] = []
    last_ns: int | None = None
    for record in records:
        now_ns = record.arrived_ns
        if lot and not 0 <= now_ns - lot[0].arrived_ns <= LOT_NS:
            last_ns = lot[-1].arrived_ns
            yield lot, last_ns
            lot = []
        if not lot and last_ns is not None:
            for idle_ns in range(last_ns + step_ns, min(now_ns, last_ns + quiet_ns), step_ns):
                last_ns = idle_ns
                yield [], idle_ns
        if concerns(record):
            lot.append(record)
    if lot:
        yield lot, lot[-1].arrived_ns


def _only(labels: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    return labels_of(next(iter(labels), "unknown"), labels)
