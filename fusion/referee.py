"""The referee: roster, weights, rule and judge together; posteriors in, judgement and verdicts out. Pure."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from common.clock_skew import Reading
from common.messages import (
    ABSTAIN,
    Agreement,
    JudgementMessage,
    Movement,
    PosteriorMessage,
    VerdictMessage,
    VocabularyReference,
    Vote,
)
from common.probability import entropy_bits
from common.vocabulary import Vocabulary
from fusion.clocks import Clocks
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
        self._clocks = Clocks(observers)
        self._judge = Judge(conduct)
        self._grounds: Mapping[int, JudgementMessage] = {}
        self._seq = 0

    def hear(self, observer: str, message: PosteriorMessage, now_ns: int) -> str | None:
        """Take one posterior; returns why it was not used, or None."""
        captured_ns = self._clocks.captured_ns(observer, message, now_ns)
        reason = self._roster.receive(observer, message, now_ns, captured_ns)
        if reason is None:
            self._clocks.heard(observer, message)
        return reason

    def read_clock(self, observer: str, reading: Reading) -> None:
        """An observer was asked what time it has."""
        self._clocks.read(observer, reading)

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

    def skew_s(self, observer: str) -> float | None:
        """Seconds by which an observer's clock is ahead of ours; None while it was never asked."""
        return self._clocks.skew_s(observer)

    def judge(self, now_ns: int) -> Ruling:
        """What the judges together believe at `now_ns`, and what that decides."""
        opinions = self._roster.opinions(now_ns)
        return self.rule_on([replace(o, skew_s=self._clocks.skew_s(o.observer)) for o in opinions], now_ns)

    def rule_on(self, opinions: Sequence[Opinion], now_ns: int) -> Ruling:
        """The same for opinions that were gathered elsewhere, e.g. recorded: one for each observer, in their order."""
        p = np.array([o.p for o in opinions])
        pooled = self._rule.pool(p, self._roster.prior)
        judgement = self._judgement(opinions, entropy_bits(p), pooled, now_ns)
        belief = Belief(now_ns, judgement.label, max(judgement.p), judgement.agreement.k, _rest(opinions))
        # Before anybody was heard, as after a restart in a movement, silence says nothing.
        decision = self._judge.watch(belief) if any(o.age_s is not None for o in opinions) else None
        judgement = judgement.model_copy(update={"movement": self._movement()})
        grounds = {**self._grounds, now_ns: judgement}
        self._keep(grounds)
        return Ruling(judgement, [self._verdict(judgement, decision, grounds)] if decision else [])

    def continue_from(self, judgement: JudgementMessage) -> None:
        """Go on where another fusion service was: its numbering, its movement and, from a verdict, its grounds."""
        self._seq = judgement.seq
        if isinstance(judgement, VerdictMessage):
            self._judge.follow(None if judgement.ended_ns is not None else _decided(judgement))
            self._keep({**self._grounds, judgement.decided_ns: judgement})
        else:
            self._judge.follow(None if judgement.movement is None else _decided(judgement.movement))
            self._keep(self._grounds)

    def _keep(self, grounds: Mapping[int, JudgementMessage]) -> None:
        self._grounds = {at_ns: grounds[at_ns] for at_ns in self._judge.grounds_at if at_ns in grounds}

    def _movement(self) -> Movement | None:
        if self._judge.movement is None:
            return None
        began_ns, decision = self._judge.movement
        label, decided_ns = (None, None) if decision is None else (decision.label, decision.decided_ns)
        return Movement(id=self._verdict_id(began_ns), began_ns=began_ns, label=label, decided_ns=decided_ns)

    def _verdict_id(self, began_ns: int) -> str:
        return f"{self._scene}-{began_ns // 1_000_000}"

    def _judgement(
        self, opinions: Sequence[Opinion], entropies: Floats, pooled: Pooled, now_ns: int
    ) -> JudgementMessage:
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
            rest=opinion.rest,
            skew_s=opinion.skew_s,
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
            fusion=self._conduct.id,
            seq=judgement.seq,
            at_ns=judgement.at_ns,
            movement=None,
            label=decision.label,
            id=self._verdict_id(decision.began_ns),
            began_ns=decision.began_ns,
            decided_ns=decision.decided_ns,
            ended_ns=decision.ended_ns,
        )
        return VerdictMessage.model_validate(said)


def _decided(said: Movement | VerdictMessage) -> tuple[int, Decision | None]:
    """The movement as the judge has it: when it began, and what was decided of it so far."""
    if said.label is None or said.decided_ns is None:
        return said.began_ns, None
    return said.began_ns, Decision(said.label, said.began_ns, said.decided_ns)


def _rest(opinions: Sequence[Opinion]) -> float:
    """The chance that the person is at rest: the mean over the judges who see him now, else over those who last did.

    Not by the weights of the rule: who cannot tell two movements apart still sees that somebody moves, and one who is
    sure and wrong must not hold a movement open for ever. When all have gone, those who went lately are believed a
    little longer, for it may be the line that broke; all silent for long is rest.
    """
    for state in HEARD:
        said = [opinion.rest for opinion in opinions if opinion.state == state]
        if said:
            return sum(said) / len(said)
    said = [opinion.rest for opinion in opinions if opinion.rest < 1.0]
    return sum(said) / len(said) if said else 1.0
