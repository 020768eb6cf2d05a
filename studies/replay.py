"""Replaying a capture offline: every verdict judged anew, beside the one that was recorded. Pure."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeVar

from common.capture_file import GONE, CaptureRecord
from common.errors import LabanmeshError
from common.keys import observer_of
from common.messages import JudgementMessage, Message, VerdictMessage, VocabularyMessage
from common.vocabulary import Vocabulary
from common.wire import BadMessage, decode, encode
from fusion.engine.engine import EngineOutput
from studies.rehearing import from_posteriors
from studies.rejudging import Change, FromJudgements
from studies.verdict_rows import Row, Saying, rows_of

if TYPE_CHECKING:
    from common.capture_file import CaptureFile
    from common.keys import SceneKeys

Source = Literal["judgements", "posteriors"]
Progress = Callable[[str, int, int], None]
EVERY = 500
M = TypeVar("M", bound=Message)


@dataclass(frozen=True, slots=True)
class Replayed:
    """A capture judged anew.

    `judgements` were recorded, of which `same` came out bit for bit; `missing` were made and not heard.
    """

    source: Source
    change: Change
    rows: Sequence[Row]
    records: int
    seconds: float
    began_ns: int
    judgements: int = 0
    same: int = 0
    missing: int = 0

    @property
    def faithful(self) -> bool:
        """Whether nothing came out otherwise than it may: with a change anything may, and so may what began before."""
        if self.change.any:
            return True
        enough = {"bit for bit"} if self.source == "judgements" else {"bit for bit", "same label"}
        recorded = any(row.recorded for row in self.rows) or self.judgements > 0
        return not recorded or all(row.likeness in enough for row in self.rows if not row.partly)


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
