"""Judges a capture again offline, from its judgements, and compares the verdicts. Pure."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeVar

from common import SECOND_NS
from common.arrival import GONE, CaptureRecord
from common.errors import LabanmeshError
from common.keys import observer_of
from common.messages import (
    JudgementMessage,
    Message,
    VerdictMessage,
    VocabularyMessage,
)
from common.vocabulary import Vocabulary
from common.wire import BadMessage, decode, encode, is_short
from studies.replay.comparison import ReplayResult, VerdictRecord, compare_verdicts
from studies.replay.from_judgements import Gap, JudgementReplay, ReplayChange

if TYPE_CHECKING:
    from common.capture_file import CaptureFile

Progress = Callable[[str, int, int], None]
PROGRESS_EVERY = 500
VERDICTS_REPEATED = 10
"""A service sends at most this many verdicts again."""
M = TypeVar("M", bound=Message)


def judge_again(capture: "CaptureFile", change: ReplayChange, progress: Progress = lambda *_: None) -> ReplayResult:
    """Judge `capture` again from its judgements, bit for bit if they have full votes.

    Raises BadInput for an impossible change, LabanmeshError for a capture without anything to judge.
    """
    change.check(capture.scene.roster)
    summary = _summarise(capture)
    if not summary.judgements:
        raise LabanmeshError(
            f"{capture.path}: contains no judgements: there is nothing to judge again; capture while fusion runs"
        )
    change = change.in_place_of(summary.rule)
    replayed = _from_judgements(capture, summary, change, progress)
    # The judgements of the last verdicts may be missing at the end of the capture.
    recorded = summary.verdicts[: len(summary.verdicts) - summary.after_last]
    # Short votes are not exact: nothing needs to agree.
    gaps = replayed.gaps if summary.full else [Gap(0, summary.ended_ns)]
    return ReplayResult(
        change=change,
        rows=compare_verdicts(recorded, replayed.verdicts, gaps),
        records=summary.records,
        seconds=(summary.ended_ns - summary.began_ns) / SECOND_NS,
        began_ns=summary.began_ns,
        judgements=replayed.judgements,
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
    last: dict[str | None, tuple[str, str | None, int]] = {}
    vocabularies, replays = summary.vocabularies, dict[str | None, JudgementReplay]()

    def replay_of(person: str | None) -> JudgementReplay:
        if person not in replays:
            replays[person] = JudgementReplay(capture.scene, vocabularies, change)
        return replays[person]

    for record in capture.records():
        if record.kind == "put" and record.key in (keys.judgement, keys.votes):
            judgement = _decoded(JudgementMessage, record)
            # The same judgement comes with full votes and with short ones.
            if judgement is None or (summary.full and is_short(judgement)):
                continue
            person = judgement.person
            if last.get(person) == _step(judgement):
                continue
            last[person], output = _step(judgement), replay_of(person).fuse(judgement)
            if output is not None:
                same += encode(output.judgement, full=not is_short(judgement)) == record.payload
                verdicts += [VerdictRecord(verdict, encode(verdict)) for verdict in output.verdicts]
            number += 1
            if number % PROGRESS_EVERY == 0:
                progress("judging again", number, summary.judgements)
        elif record.kind == "put" and record.key == keys.vocabulary:
            if (message := _decoded(VocabularyMessage, record)) is not None:
                vocabularies = {**vocabularies, message.hash: message.vocabulary}
                for replay in replays.values():
                    replay.set_times(message.vocabulary)
        elif record.key == keys.verdict and (verdict := _decoded(VerdictMessage, record)):
            replay_of(verdict.person).set_verdict(verdict)
        elif record.kind == "token" and record.payload == GONE and record.key.startswith(f"{keys.root}/fusion/"):
            for replay in replays.values():
                replay.set_gone(observer_of(record.key))
    missing = sum(replay.missing for replay in replays.values())
    return _Replayed(verdicts, number, same, missing, [gap for replay in replays.values() for gap in replay.gaps])


def _step(judgement: JudgementMessage) -> tuple[str, str | None, int]:
    """The key of a step."""
    return judgement.fusion, judgement.session, judgement.seq


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
