"""The referee: roster, weights, rule and judge together; posteriors in, judgement and verdicts out. Pure."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from common.messages import (
    ABSTAIN,
    Agreement,
    JudgementMessage,
    PosteriorMessage,
    VerdictMessage,
    VocabularyReference,
    Vote,
)
from common.probability import entropy_bits
from common.vocabulary import Vocabulary
from fusion.judge import Belief, Decision, Demand, Judge
from fusion.roster import Opinion, Patience, Roster
from fusion.rules import Floats, Pooled, rule_named


class Conduct(Patience, Demand, Protocol):
    """How a referee judges: the [fusion] part of a scene file."""

    @property
    def id(self) -> str:
        """The fusion service's id."""

    @property
    def rule(self) -> str:
        """Name of the fusion rule."""


HEARD = ("counted", "stale")
"""States of a vote that is one: the others say nothing."""
KNOWS_NOTHING = 0.01
"""A belief that differs by no more than this from the prior holds no label."""


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
        self._grounds: Mapping[int, JudgementMessage] = {}
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
        p = np.array([o.p for o in opinions])
        pooled = self._rule.pool(p, self._roster.prior)
        judgement = self._judgement(opinions, entropy_bits(p), pooled, now_ns)
        belief = Belief(now_ns, judgement.label, max(judgement.p), judgement.agreement.k, _rest(opinions))
        decision = self._judge.watch(belief)
        grounds = {**self._grounds, now_ns: judgement}
        self._grounds = {at_ns: grounds[at_ns] for at_ns in self._judge.grounds_at if at_ns in grounds}
        return Ruling(judgement, [self._verdict(judgement, decision, grounds)] if decision else [])

    def _judgement(self, opinions: list[Opinion], entropies: Floats, pooled: Pooled, now_ns: int) -> JudgementMessage:
        label = self.vocabulary.labels[int(pooled.p.argmax())]
        told = zip(opinions, entropies.tolist(), pooled.weights.tolist(), strict=True)
        votes = {opinion.observer: self._vote(opinion, entropy, weight) for opinion, entropy, weight in told}
        heard = [vote for vote in votes.values() if vote.state in HEARD]
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

    def _vote(self, opinion: Opinion, entropy: float, weight: float) -> Vote:
        said = opinion.state in HEARD
        # The likeliest label of who knows nothing is the first of the vocabulary, and no agreement with anybody.
        holds = said and bool(np.abs(opinion.p - self._roster.prior).max() > KNOWS_NOTHING)
        return Vote(
            label=self.vocabulary.labels[int(opinion.p.argmax())] if holds else None,
            entropy=entropy if said else None,
            weight=weight,
            age_s=opinion.age_s,
            state=opinion.state,
            p=opinion.p.tolist() if said else None,
        )

    def _verdict(
        self, judgement: JudgementMessage, decision: Decision, grounds: Mapping[int, JudgementMessage]
    ) -> VerdictMessage:
        """The decision on its grounds: when its end is said, the votes are still those that decided it.

        Those of an abstention are the last of the movement; after it they forget what they could not agree on.
        """
        grounds_ns = decision.ended_ns if decision.label == ABSTAIN else decision.decided_ns
        said = grounds.get(grounds_ns or 0, judgement).model_dump()
        said.update(
            seq=judgement.seq,
            at_ns=judgement.at_ns,
            label=decision.label,
            id=f"{self._scene}-{decision.began_ns // 1_000_000}",
            began_ns=decision.began_ns,
            decided_ns=decision.decided_ns,
            ended_ns=decision.ended_ns,
        )
        return VerdictMessage.model_validate(said)


def _rest(opinions: Sequence[Opinion]) -> float:
    """The chance that the person is at rest: the mean over the judges who see him now, else over those who last did.

    Not by the weights of the rule: who cannot tell two movements apart still sees that somebody moves, and one who is
    sure and wrong must not hold a movement open for ever. Who is silent says nothing of rest; all silent is rest.
    """
    for state in HEARD:
        said = [opinion.rest for opinion in opinions if opinion.state == state]
        if said:
            return sum(said) / len(said)
    return 1.0
