"""The referee: roster, weights, rule and judge together; posteriors in, judgement and verdicts out. Pure."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from common.messages import (
    Agreement,
    JudgementMessage,
    PosteriorMessage,
    VerdictMessage,
    Vote,
    VocabularyReference,
)
from common.probability import entropy_bits
from common.vocabulary import Vocabulary
from fusion.judge import Belief, Decision, Demand, Judge
from fusion.roster import Opinion, Patience, Roster
from fusion.rules import Pooled, rule_named


class Conduct(Patience, Demand, Protocol):
    """How a referee judges: the [fusion] part of a scene file."""

    @property
    def id(self) -> str:
        """The fusion service's id."""

    @property
    def rule(self) -> str:
        """Name of the fusion rule."""


@dataclass(frozen=True, slots=True)
class Ruling:
    """One step's result."""

    judgement: JudgementMessage
    verdicts: Sequence[VerdictMessage]


class Referee:
    """Hears the observers of one scene and judges.

    Raises BadInput for an unknown rule, or a rule that cannot hear so many observers.
    """

    def __init__(self, scene: str, observers: list[str], vocabulary: Vocabulary, conduct: Conduct) -> None:
        self.vocabulary = vocabulary
        self._scene = scene
        self._conduct = conduct
        self._rule = rule_named(conduct.rule, len(observers))
        self._roster = Roster(observers, vocabulary, conduct)
        self._judge = Judge(conduct)
        self._seq = 0

    def hear(self, observer: str, message: PosteriorMessage, now_ns: int) -> str | None:
        """Take one posterior; returns why it was not used, or None."""
        return self._roster.receive(observer, message, now_ns)

    def reject(self, observer: str, reason: str) -> None:
        """Count a message that could not even be read."""
        self._roster.reject(observer, reason)

    def present(self, observers: frozenset[str]) -> None:
        """Who is alive on the mesh now."""
        self._roster.present(observers)

    @property
    def rejected(self) -> Mapping[str, Counter[str]]:
        """Per observer, how many of its messages could not be used, by reason."""
        return self._roster.rejected

    def judge(self, now_ns: int) -> Ruling:
        """What the judges together believe at `now_ns`, and what that decides."""
        opinions = self._roster.opinions(now_ns)
        pooled = self._rule.pool(np.array([o.p for o in opinions]), self._roster.prior)
        judgement = self._judgement(opinions, pooled, now_ns)
        rest = float(sum(w * o.rest for w, o in zip(pooled.weights, opinions, strict=True)))
        belief = Belief(now_ns, judgement.label, max(judgement.p), judgement.agreement.k, rest)
        decision = self._judge.watch(belief)
        return Ruling(judgement, [self._verdict(judgement, decision)] if decision else [])

    def _judgement(self, opinions: list[Opinion], pooled: Pooled, now_ns: int) -> JudgementMessage:
        label = self.vocabulary.labels[int(pooled.p.argmax())]
        votes = {o.observer: self._vote(o, w) for o, w in zip(opinions, pooled.weights, strict=True)}
        heard = [vote for vote in votes.values() if vote.state in ("counted", "stale")]
        self._seq += 1
        return JudgementMessage(
            scene=self._scene,
            fusion=self._conduct.id,
            seq=self._seq,
            at_ns=now_ns,
            vocabulary=VocabularyReference(name=self.vocabulary.name, hash=self.vocabulary.digest),
            p=pooled.p.tolist(),
            label=label,
            certainty_bits=float(entropy_bits(pooled.p)),
            rule=self._rule.name,
            votes=votes,
            agreement=Agreement(k=sum(vote.label == label for vote in heard), n=len(heard)),
        )

    def _vote(self, opinion: Opinion, weight: float) -> Vote:
        said = opinion.state in ("counted", "stale")
        return Vote(
            label=self.vocabulary.labels[int(opinion.p.argmax())] if said else None,
            entropy=float(entropy_bits(opinion.p)) if said else None,
            weight=float(weight),
            age_s=opinion.age_s,
            state=opinion.state,
            p=opinion.p.tolist() if said else None,
        )

    def _verdict(self, judgement: JudgementMessage, decision: Decision) -> VerdictMessage:
        said = judgement.model_dump()
        said.update(
            label=decision.label,
            id=f"{self._scene}-{decision.began_ns // 1_000_000}",
            began_ns=decision.began_ns,
            decided_ns=decision.decided_ns,
            ended_ns=decision.ended_ns,
        )
        return VerdictMessage.model_validate(said)
