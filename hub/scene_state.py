"""What is known about a scene from what was heard: messages folded into the state that views show. Pure."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from common.messages import (
    JudgementMessage,
    Message,
    StatusMessage,
    VerdictMessage,
    VocabularyMessage,
    VocabularyReference,
    Vote,
    VoteState,
)
from common.vocabulary import ABSTAIN

VERDICTS_KEPT = 10
SOMETHING_ELSE = "something else"
"""What is told of an answer that is none of the movements; no label has a space."""
SILENT_AFTER_S = 2.0
"""A referee that judged at every step and has said nothing for so long is told to be silent."""
REORDERED_NS = 1_000_000_000
"""A judgement older than the one shown by less than this is a late or repeated copy; older still, a clock was set."""

Role = Literal["observer", "fusion"]


@dataclass(frozen=True, slots=True)
class Belief:
    """One movement and its probability, 0 to 1."""

    label: str
    p: float


@dataclass(frozen=True, slots=True)
class Judge:
    """One observer as the audience sees it; entropy in bits, weight 0 to 1, age in seconds at the state's now.

    skew_s: how far its clock is ahead of the fusion machine's. rejected: messages of it that fusion could not use.
    reliability: what the referee learned of it from earlier verdicts, 1 is nothing against it.
    """

    name: str
    label: str | None
    beliefs: tuple[Belief, ...]
    entropy: float | None
    weight: float
    age_s: float | None
    state: VoteState
    agrees: bool
    status: StatusMessage | None
    skew_s: float | None = None
    rejected: int = 0
    reliability: float | None = None


@dataclass(frozen=True, slots=True)
class SceneState:
    """All that was heard of a scene until `now_ns` (this machine's clock); `fold` gives the next state.

    `observers` are the judges the scene file names: they have a corner before they have spoken. `verdicts`
    are newest first, at most VERDICTS_KEPT. `heard_ns` is when `judgement` came, by this machine's clock, so
    that ages need no agreement between clocks. `rejected` counts messages that could not be understood.
    """

    scene: str
    observers: tuple[str, ...] = ()
    now_ns: int = 0
    vocabulary: VocabularyMessage | None = None
    judgement: JudgementMessage | None = None
    heard_ns: int = 0
    verdicts: tuple[VerdictMessage, ...] = ()
    observer_status: Mapping[str, StatusMessage] = field(default_factory=dict)
    fusion_status: Mapping[str, StatusMessage] = field(default_factory=dict)
    rejected: int = 0

    def at(self, now_ns: int) -> "SceneState":
        """The same knowledge, looked at later: only ages change."""
        return replace(self, now_ns=now_ns)

    def fold(self, message: Message, heard_ns: int, role: Role = "observer") -> "SceneState":
        """The state after `message` was heard; `role` says whose a status is.

        What is a copy, or of another kind, changes nothing: the very same state is returned.
        """
        match message:
            case VerdictMessage() if message in self.verdicts:
                return self
            case VerdictMessage():
                return replace(self, verdicts=_with_verdict(self.verdicts, message))
            case JudgementMessage():
                late = self.judgement is not None and _is_copy(message, self.judgement)
                return self if late else replace(self, judgement=message, heard_ns=heard_ns)
            case StatusMessage() if role == "observer":
                return replace(self, observer_status={**self.observer_status, message.id: message})
            case StatusMessage():
                return replace(self, fusion_status={**self.fusion_status, message.id: message})
            case VocabularyMessage() if self.judgement and message.hash != self.judgement.vocabulary.hash:
                return self  # a stranger's: whoever is asked may answer
            case VocabularyMessage():
                return replace(self, vocabulary=message)
            case _:
                return self

    def reject(self) -> "SceneState":
        """The state after a message that could not be understood."""
        return replace(self, rejected=self.rejected + 1)

    @property
    def silence_s(self) -> float:
        """Seconds since the last judgement was heard; infinite before the first."""
        return math.inf if self.judgement is None else max(0.0, (self.now_ns - self.heard_ns) / 1e9)

    @property
    def silent(self) -> bool:
        """Whether a referee that judged has fallen silent."""
        return self.judgement is not None and self.silence_s > SILENT_AFTER_S

    @property
    def labels(self) -> tuple[str, ...]:
        """The movements in the order of every `p`; empty while the judgement's vocabulary is unknown."""
        if self.vocabulary is None or self.missing_vocabulary is not None:
            return ()
        return tuple(self.vocabulary.labels)

    @property
    def missing_vocabulary(self) -> VocabularyReference | None:
        """The vocabulary that the judgement speaks and nobody has told us, or None."""
        if self.judgement is None or (self.vocabulary and self.vocabulary.hash == self.judgement.vocabulary.hash):
            return None
        return self.judgement.vocabulary

    @property
    def verdict(self) -> VerdictMessage | None:
        """The newest verdict, ended or not."""
        return self.verdicts[0] if self.verdicts else None

    @property
    def fused(self) -> tuple[Belief, ...]:
        """What the judges together believe, the most probable first; empty before the first judgement."""
        said = self.judgement
        return () if said is None else self.beliefs(said.p, said.label, said.unlearned)

    @property
    def judges(self) -> tuple[Judge, ...]:
        """Every observer that the scene names or that was heard of, the scene's order first."""
        votes = {} if self.judgement is None else self.judgement.votes
        names = dict.fromkeys((*self.observers, *sorted(votes), *sorted(self.observer_status)))
        return tuple(self._judge(name, votes.get(name)) for name in names)

    @property
    def standing_by(self) -> tuple[str, ...]:
        """The fusion services that run and do not lead."""
        leads = None if self.judgement is None else self.judgement.fusion
        return tuple(sorted(n for n, s in self.fusion_status.items() if n != leads and s.state == "running"))

    def _rejected(self, observer: str) -> int:
        said = self.fusion_status.get(self.judgement.fusion) if self.judgement else None
        account = (said.observers or {}).get(observer) if said else None
        return sum(account.rejected.values()) if account else 0

    def _judge(self, name: str, vote: Vote | None) -> Judge:
        status = self.observer_status.get(name)
        if vote is None or self.judgement is None:
            return Judge(name, None, (), None, 0.0, None, "silent", False, status)
        age_s = None if vote.age_s is None else vote.age_s + self.silence_s
        agrees = vote.state == "counted" and vote.label == self.judgement.label
        beliefs = self.beliefs(vote.p or [], vote.label, vote.unlearned)
        return Judge(name, vote.label, beliefs, vote.entropy, vote.weight, age_s, vote.state, agrees, status,
                     vote.skew_s, self._rejected(name), vote.reliability)  # fmt: skip

    def beliefs(self, p: list[float], label: str | None, unlearned: float | None = None) -> tuple[Belief, ...]:
        """All answers, the most probable first: `p` over the movements and, where it is said, something else."""
        other = None if unlearned is None or not p else _share(unlearned)
        shares = [_share(value) * (1.0 - (other or 0.0)) for value in p]
        said = [*zip(self.labels or _placeholders(p, label), shares, strict=False)]
        said += [] if other is None else [(SOMETHING_ELSE, other)]
        # Whole percents decide the order, so that rows of noise do not change places at every step.
        ranked = sorted(said, key=lambda pair: -round(pair[1], 2))
        return tuple(Belief(name, share) for name, share in ranked)


def is_abstention(verdict: VerdictMessage) -> bool:
    """Whether the judges saw that something was done and could not agree what."""
    return verdict.label == ABSTAIN


def _placeholders(p: list[float], label: str | None) -> tuple[str, ...]:
    """Names while the vocabulary is unknown: the top one is told by `label`, the others are numbered from 1."""
    top = max(range(len(p)), key=lambda i: _share(p[i]), default=-1)
    return tuple(label if i == top and label else f"movement {i + 1}" for i in range(len(p)))


def _share(value: float) -> float:
    """A stranger's number as a share that can be drawn: 0 to 1, never NaN."""
    return min(1.0, max(0.0, value)) if math.isfinite(value) else 0.0


def _is_copy(message: JudgementMessage, shown: JudgementMessage) -> bool:
    return message.fusion == shown.fusion and 0 <= shown.at_ns - message.at_ns < REORDERED_NS


def _with_verdict(verdicts: tuple[VerdictMessage, ...], verdict: VerdictMessage) -> tuple[VerdictMessage, ...]:
    """Newest heard first; the same id said again takes its predecessor's place, unless it is the older word.

    The order is that of hearing: a fusion machine whose clock was set back must not hide its new verdicts.
    """
    known = {old.id: old for old in verdicts}
    if verdict.id not in known:
        return (verdict, *verdicts)[:VERDICTS_KEPT]
    if verdict.at_ns < known[verdict.id].at_ns:
        return verdicts
    return tuple(verdict if old.id == verdict.id else old for old in verdicts)
