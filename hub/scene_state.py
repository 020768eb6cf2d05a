"""What a hub knows about a scene: messages folded into the state that all views show. Pure."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from common import SECOND_NS
from common.fall_messages import FallMessage
from common.message_types import CONTRADICTED
from common.messages import (
    JudgementMessage,
    StatusMessage,
    VerdictMessage,
    VocabularyMessage,
    VocabularyReference,
    Vote,
    VoteState,
)
from common.same_movement import with_verdict
from common.vocabulary import ABSTAIN
from hub import people, same_id

VERDICTS_LIMIT = 10
VERDICTS_WAIT_LIMIT = 1000
"""How many verdicts wait for a loop, or a broker, beyond which the oldest are dropped."""
SHOWN_STRANGERS_LIMIT = 64
"""Processes that the scene file does not name are shown up to this number: names can be invented."""
SOMETHING_ELSE = "something else"  # shown for an answer that is none of the movements; no label contains a space
SILENT_AFTER_S = 2.0  # a fusion service without a judgement for so long is shown as silent
HEARD_STATES = frozenset({"counted", "stale"})  # of a vote that enters the judgement, fresh or fading
REORDERED_NS = SECOND_NS
"""A judgement that is older than the newest by less than this is a late copy; if it is older still, a clock was set."""

SenderRole = Literal["observer", "fusion"]
SceneMessage = JudgementMessage | StatusMessage | VocabularyMessage | FallMessage
MESSAGE_KINDS: Mapping[str, type[SceneMessage]] = {
    "judgement": JudgementMessage,
    "verdict": VerdictMessage,
    "status": StatusMessage,
    "vocabulary": VocabularyMessage,
    "fall": FallMessage,
}
"""The last part of a key names the kind of message."""


@dataclass(frozen=True, slots=True)
class RankedLabel:
    """One answer (a movement, or SOMETHING_ELSE) and its probability, 0 to 1."""

    label: str
    p: float


@dataclass(frozen=True, slots=True)
class ObserverState:
    """One observer as fusion sees it: its vote, its status and what fusion noticed about it.

    entropy: bits. weight: 0 to 1. age_s: at the scene state's now. agrees: it is one of the k in the judgement's
    agreement "k of n". skew_s: how far its clock is ahead of the fusion machine's. rejected: how many of its messages
    fusion rejected. reliability: learned from earlier verdicts, 1 is full. has_same_id: two processes have its id.
    sees_nobody: in its pictures. rest_reliability, label_reliability: how far it is trusted, if others contradict it.
    """

    name: str
    label: str | None
    ranked: tuple[RankedLabel, ...]
    entropy: float | None
    weight: float
    age_s: float | None
    state: VoteState
    agrees: bool
    status: StatusMessage | None
    skew_s: float | None = None
    rejected: int = 0
    reliability: float | None = None
    has_same_id: bool = False
    rest_reliability: float | None = None
    label_reliability: float | None = None
    sees_nobody: bool = False

    @property
    def is_heard(self) -> bool:
        """Whether its vote enters the judgement."""
        return self.state in HEARD_STATES


@dataclass(frozen=True, slots=True)
class SceneState:
    """Everything received about a scene until `now_ns` (this machine's clock); `fold` returns the next state.

    roster: the observers in the scene file; each is shown from the start. services: its fusion services.
    next_vocabulary: one that the judgement does not have yet. verdicts: newest first, at most VERDICTS_LIMIT.
    received_ns: when `judgement` arrived, by this machine's clock, so that ages do not depend on synchronised clocks.
    rejected, dropped, skipped: messages that were rejected, lost to a full queue, left out since a newer one was there.
    same_id_reports: see hub/same_id.py. others: of those who are not in `judgement`. fall: the worst of `falls`.
    """

    scene: str
    roster: tuple[str, ...] = ()
    now_ns: int = 0
    vocabulary: VocabularyMessage | None = None
    next_vocabulary: VocabularyMessage | None = None
    judgement: JudgementMessage | None = None
    received_ns: int = 0
    verdicts: tuple[VerdictMessage, ...] = ()
    observer_status: Mapping[str, StatusMessage] = field(default_factory=dict)
    fusion_status: Mapping[str, StatusMessage] = field(default_factory=dict)
    rejected: int = 0
    dropped: int = 0
    skipped: int = 0
    services: tuple[str, ...] = ()
    same_id_reports: same_id.Reports = field(default_factory=dict)
    fall: FallMessage | None = None
    falls: Mapping[str, FallMessage] = field(default_factory=dict)
    others: people.Others = field(default_factory=dict)

    def at(self, now_ns: int) -> "SceneState":
        """The same knowledge at a later time: only ages change."""
        return replace(self, now_ns=now_ns)

    def fold(self, message: SceneMessage, received_ns: int, role: SenderRole = "observer") -> "SceneState":
        """The state after `message`; `role` is the sender's, for a status message.

        A copy changes nothing: the same object is returned.
        """
        match message:
            case VerdictMessage() if message in self.verdicts:
                return self
            case VerdictMessage():
                verdicts = with_verdict(self.verdicts, message, VERDICTS_LIMIT)
                return self if verdicts is self.verdicts else replace(self, verdicts=verdicts)
            case JudgementMessage() if people.is_beside(message, self.judgement):
                others = people.with_other(self.others, message)
                return self if others is self.others else replace(self, others=others)
            case JudgementMessage():
                newest = self.judgement
                is_same = newest is not None and message.fusion == newest.fusion
                if newest is not None and is_same and 0 <= newest.at_ns - message.at_ns < REORDERED_NS:
                    return self
                return self._with_judgement(message, received_ns)
            case StatusMessage():
                return self._with_status(message, role, received_ns)
            case FallMessage():
                falls = {**self.falls, message.person or "": message}
                return replace(self, falls=falls, fall=people.worst(falls))
            case VocabularyMessage() if self.judgement and message.hash != self.judgement.vocabulary.hash:
                # Any process may answer a query, also one with another vocabulary; it may be the next one.
                return replace(self, next_vocabulary=message)
            case VocabularyMessage():
                return replace(self, vocabulary=message)

    def _with_status(self, message: StatusMessage, role: SenderRole, received_ns: int) -> "SceneState":
        """The state with the status; of processes that the scene does not name, SHOWN_STRANGERS_LIMIT are kept."""
        known = self.observer_status if role == "observer" else self.fusion_status
        expected = self.roster if role == "observer" else self.services
        is_new = message.id not in known and message.id not in expected
        if is_new and sum(each not in expected for each in known) >= SHOWN_STRANGERS_LIMIT:
            return self
        statuses = {**known, message.id: message}
        if role == "observer":
            return replace(self, observer_status=statuses)
        reports = same_id.with_reports(self.same_id_reports, known.get(message.id), message, received_ns)
        return replace(self, fusion_status=statuses, same_id_reports=reports)

    def _with_judgement(self, message: JudgementMessage, received_ns: int) -> "SceneState":
        coming = self.next_vocabulary
        if coming is not None and message.vocabulary.hash == coming.hash:
            return replace(self, judgement=message, received_ns=received_ns, vocabulary=coming, next_vocabulary=None)
        return replace(self, judgement=message, received_ns=received_ns)

    def has_stage(self, fall: FallMessage) -> bool:
        """Whether the last message on the falls of that person says the same stage."""
        last = self.falls.get(fall.person or "")
        return last is not None and (last.id, last.stage) == (fall.id, fall.stage)

    def reject(self) -> "SceneState":
        """The state after a message that was rejected."""
        return replace(self, rejected=self.rejected + 1)

    @property
    def is_empty(self) -> bool:
        """Whether nothing has been received from any process of the scene."""
        return not (self.judgement or self.verdicts or self.observer_status or self.fusion_status)

    @property
    def same_ids(self) -> tuple[str, ...]:
        """Ids that two processes use now (`same_id.at`)."""
        return same_id.at(self.same_id_reports, self.now_ns)

    @property
    def silence_s(self) -> float:
        """Seconds since the last judgement arrived; infinite before the first."""
        return math.inf if self.judgement is None else max(0.0, (self.now_ns - self.received_ns) / SECOND_NS)

    @property
    def silent(self) -> bool:
        """Whether fusion has published judgements and has stopped."""
        return self.judgement is not None and self.silence_s > SILENT_AFTER_S

    @property
    def waiting(self) -> bool:
        """Whether fusion publishes judgements and no observer contributes to them."""
        return self.judgement is not None and is_waiting(self.judgement)

    @property
    def people(self) -> Sequence[JudgementMessage]:
        """The judgements of everybody who is there, by name; empty in a scene that judges one person."""
        return people.all_judged(self.judgement, self.others)

    @property
    def labels(self) -> tuple[str, ...]:
        """The movements in the order of every `p`; empty while the judgement's vocabulary is unknown."""
        if self.vocabulary is None or self.missing_vocabulary is not None:
            return ()
        return tuple(self.vocabulary.labels)

    @property
    def missing_vocabulary(self) -> VocabularyReference | None:
        """The vocabulary of the judgement if it has not arrived yet, else None."""
        if self.judgement is None or (self.vocabulary and self.vocabulary.hash == self.judgement.vocabulary.hash):
            return None
        return self.judgement.vocabulary

    @property
    def verdict(self) -> VerdictMessage | None:
        """The newest verdict, ended or not."""
        return self.verdicts[0] if self.verdicts else None

    @property
    def fused(self) -> tuple[RankedLabel, ...]:
        """The fused posterior, the most probable first; empty without a judgement or without observers."""
        if self.judgement is None or self.waiting:
            return ()
        return self.ranked(self.judgement.p, self.judgement.label, self.judgement.unlearned)

    @property
    def observers(self) -> tuple[ObserverState, ...]:
        """Every observer of the scene file, then every other one with a vote or a status."""
        votes = {} if self.judgement is None else self.judgement.votes
        names = dict.fromkeys((*self.roster, *sorted(votes), *sorted(self.observer_status)))
        return tuple(self._observer(name, votes.get(name)) for name in names)

    @property
    def standing_by(self) -> tuple[str, ...]:
        """The fusion services that run and do not publish judgements."""
        leader = None if self.judgement is None else self.judgement.fusion
        return tuple(sorted(n for n, s in self.fusion_status.items() if n != leader and s.state == "running"))

    def _observer(self, name: str, vote: Vote | None) -> ObserverState:
        status = self.observer_status.get(name)
        if vote is None or self.judgement is None:
            return ObserverState(name, None, (), None, 0.0, None, "silent", False, status)
        age_s = None if vote.age_s is None else vote.age_s + self.silence_s
        ranked = self.ranked(vote.p or [], vote.label, vote.unlearned)
        # One of the k of the judgement's agreement "k of n".
        agrees = is_heard(vote) and vote.label is not None and vote.label == self.judgement.label
        rejected = self._rejected(name)
        return ObserverState(name, vote.label, ranked, vote.entropy, vote.weight, age_s, vote.state, agrees, status,
                             vote.skew_s, sum(rejected.values()), vote.reliability, name in self.same_ids,
                             _doubted(vote.rest_reliability), _doubted(vote.label_reliability),
                             vote.sees_nobody)  # fmt: skip

    def _rejected(self, observer: str) -> Mapping[str, int]:
        status = self.fusion_status.get(self.judgement.fusion) if self.judgement else None
        counts = (status.observers or {}).get(observer) if status else None
        return counts.rejected if counts else {}

    def ranked(self, p: list[float], label: str | None, unlearned: float | None = None) -> tuple[RankedLabel, ...]:
        """All answers, the most probable first: `p` over the movements and, if `unlearned` is known, something else."""
        shares = [value * (1.0 - (unlearned or 0.0)) for value in p]
        pairs = [*zip(self.labels or _placeholders(p, label), shares, strict=False)]
        pairs += [] if unlearned is None or not p else [(SOMETHING_ELSE, unlearned)]
        # Sorted by whole percents, so that noise does not swap rows at every step.
        return tuple(RankedLabel(*pair) for pair in sorted(pairs, key=lambda pair: -round(pair[1], 2)))


def is_heard(vote: Vote) -> bool:
    """Whether the vote enters the judgement."""
    return vote.state in HEARD_STATES


def is_waiting(judgement: JudgementMessage) -> bool:
    """Whether no observer contributes to the judgement, so that its label means nothing."""
    return not judgement.label or not any(map(is_heard, judgement.votes.values()))


def is_abstention(verdict: VerdictMessage) -> bool:
    """Whether a movement took place and the observers did not agree on its label."""
    return verdict.label == ABSTAIN


def _placeholders(p: list[float], label: str | None) -> tuple[str, ...]:
    """Names while the vocabulary is unknown: `label` for the most probable, numbers from 1 for the others."""
    top = max(range(len(p)), key=lambda i: p[i], default=-1)
    return tuple(label if i == top and label else f"movement {i + 1}" for i in range(len(p)))


def _doubted(reliability: float | None) -> float | None:
    return None if reliability is None or reliability >= CONTRADICTED else reliability
