"""The referee: roster, weights, rule and judge together; posteriors in, judgement and verdicts out. Pure."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from common.clock_skew import ClockReading
from common.config_sections import FusionConfig
from common.messages import Contribution, JudgementMessage, OngoingMovement, PosteriorMessage, VerdictMessage
from common.vocabulary import ABSTAIN, Vocabulary
from fusion.engine.clocks import Clocks
from fusion.engine.contributions import contributions
from fusion.engine.messages import JudgementBuilder, Stamp, verdict_of
from fusion.engine.pooling import PooledPosterior, PoolingCase, pool_facets, pool_posteriors
from fusion.engine.reliability import Reliability, learn_from_verdict
from fusion.engine.roster import HEARD, AgedPosterior, ObserverRecord, Roster
from fusion.engine.rules import get_rule
from fusion.engine.verdict_detector import Decision, PooledState, VerdictDetector


@dataclass(frozen=True, slots=True)
class EngineOutput:
    """One step's result."""

    judgement: JudgementMessage
    verdicts: Sequence[VerdictMessage]


@dataclass(frozen=True, slots=True)
class _Ground:
    """What a verdict may rest on: a judgement, and the opinions that it came from, where they are known."""

    judgement: JudgementMessage
    opinions: Sequence[AgedPosterior] = ()


class FusionEngine:
    """Hears the observers of one scene and judges.

    `epoch` and `session` of the fusion service are written into each message; None leaves them out.
    Raises BadInput for an unknown rule, or a rule that cannot hear so many observers.
    """

    def __init__(self, scene: str, observers: list[str], vocabulary: Vocabulary, config: FusionConfig) -> None:
        self.vocabulary = vocabulary
        self._scene = scene
        self._config = config
        self._rule = get_rule(config.rule, len(observers))
        self._roster = Roster(observers, vocabulary, config)
        self._clocks = Clocks(observers)
        self._judge = VerdictDetector(config)
        self._scribe = JudgementBuilder(scene, vocabulary, self._roster.prior, self._rule.name)
        self._grounds: Mapping[int, _Ground] = {}
        self._contributed: tuple[object, Mapping[str, Contribution]] = (None, {})
        self._seq = 0
        self.epoch: int | None = None
        self.session: str | None = None
        self.reliability = Reliability()

    def receive(self, observer: str, message: PosteriorMessage, now_ns: int) -> str | None:
        """Take one posterior; returns why it was not used, or None."""
        captured_ns = self._clocks.captured_ns(observer, message, now_ns)
        reason = self._roster.receive(observer, message, now_ns, captured_ns)
        if reason is None:
            self._clocks.heard(observer, message)
        return reason

    def record_clock(self, observer: str, reading: ClockReading) -> None:
        """An observer was asked what time it has."""
        self._clocks.read(observer, reading)
        if observer in self._known:
            self._known[observer] = replace(self._known[observer], skew_s=self._clocks.skew_s(observer))

    def reject(self, observer: str, reason: str) -> None:
        """Count a message that could not even be read."""
        self._roster.reject(observer, reason)

    def set_present(self, observers: frozenset[str]) -> None:
        """Who is alive on the mesh now."""
        self._roster.present(observers)

    @property
    def rejected(self) -> Mapping[str, Counter[str]]:
        """Per observer, how many of its messages could not be used, by reason."""
        return self._roster.rejected

    @property
    def reliability(self) -> Reliability:
        """What was learned of the judges, to be kept over a restart."""
        return self._reliability

    @reliability.setter
    def reliability(self, reliability: Reliability) -> None:
        self._reliability = reliability
        # Asked for at every step, and changed once a verdict.
        self._known = {who: self._known_of(who) for who in self._roster.rejected}

    def skew_s(self, observer: str) -> float | None:
        """Seconds by which an observer's clock is ahead of ours; None while it was never asked."""
        return self._clocks.skew_s(observer)

    def step(self, now_ns: int) -> EngineOutput:
        """What the judges together believe at `now_ns`, and what that decides."""
        case = self.pooling_case(now_ns)
        return self.output_for(case.posteriors, now_ns, pool_posteriors(case))

    def pooling_case(self, now_ns: int) -> PoolingCase:
        """What to pool at `now_ns`. `output_for` continues from there, so that many scenes can be pooled at once."""
        return self._case(self._roster.opinions(now_ns, self._known.__getitem__))

    def _case(self, opinions: Sequence[AgedPosterior]) -> PoolingCase:
        return PoolingCase(self._rule, opinions, self._roster.prior, self._config.temperature)

    def _known_of(self, observer: str) -> ObserverRecord:
        reliability = self._reliability
        return ObserverRecord(
            self._clocks.skew_s(observer), reliability.reliability(observer), reliability.correlations(observer)
        )

    def output_for(
        self, opinions: Sequence[AgedPosterior], now_ns: int, pooled: PooledPosterior | None = None
    ) -> EngineOutput:
        """The same for opinions that were gathered elsewhere, e.g. recorded: one for each observer, in their order.

        pooled: what they come to, where that is known.
        """
        pooled = pooled or pool_posteriors(self._case(opinions))
        view = self._scribe.view(opinions, pooled)
        other = pooled.unlearned or 0.0
        belief = PooledState(now_ns, view.label, view.p * (1.0 - other), view.agreement.k, _rest(opinions), other)
        # Before anybody was heard, as after a restart in a movement, silence says nothing.
        decision = self._judge.watch(belief) if any(o.age_s is not None for o in opinions) else None
        self._seq += 1
        facets = pool_facets(self._rule, opinions)
        judgement = self._scribe.judgement(view, pooled, facets, self._movement(), self._stamp(now_ns))
        grounds = {**self._grounds, now_ns: _Ground(judgement, opinions)}
        self._keep(grounds)
        if decision is None:
            return EngineOutput(judgement, [])
        verdict = self._verdict(judgement, decision, grounds)
        self.reliability = learn_from_verdict(self.reliability, verdict, self.vocabulary)
        return EngineOutput(judgement, [verdict])

    def continue_from(self, judgement: JudgementMessage) -> None:
        """Go on where another fusion service was: its numbering, its movement and, from a verdict, its grounds."""
        self._seq = judgement.seq
        if isinstance(judgement, VerdictMessage):
            self._judge.follow(None if judgement.ended_ns is not None else _decided(judgement))
            self._keep({**self._grounds, judgement.decided_ns: _Ground(judgement)})
            self.reliability = learn_from_verdict(self.reliability, judgement, self.vocabulary)
        else:
            self._judge.follow(None if judgement.movement is None else _decided(judgement.movement))
            self._keep(self._grounds)

    def _keep(self, grounds: Mapping[int, _Ground]) -> None:
        self._grounds = {at_ns: grounds[at_ns] for at_ns in self._judge.grounds_at if at_ns in grounds}

    def _movement(self) -> OngoingMovement | None:
        if self._judge.movement is None:
            return None
        began_ns, decision = self._judge.movement
        label, decided_ns = (None, None) if decision is None else (decision.label, decision.decided_ns)
        return OngoingMovement(id=self._verdict_id(began_ns), began_ns=began_ns, label=label, decided_ns=decided_ns)

    def _stamp(self, at_ns: int) -> Stamp:
        return Stamp(self._config.id, self._seq, at_ns, self.epoch, self.session)

    def _verdict_id(self, began_ns: int) -> str:
        return f"{self._scene}-{began_ns // 1_000_000}"

    def _verdict(
        self, judgement: JudgementMessage, decision: Decision, grounds: Mapping[int, _Ground]
    ) -> VerdictMessage:
        """The decision on its grounds: when its end is said, the votes are still those that decided it.

        Those of an abstention are the last of the movement; after it they forget what they could not agree on.
        """
        grounds_ns = decision.ended_ns if decision.label == ABSTAIN else decision.decided_ns
        now = grounds[judgement.at_ns]
        ground = grounds.get(grounds_ns or 0, now)
        end = grounds.get(decision.ended_ns or 0, ground)
        contributed, verdict_id = self._contributions(ground, decision), self._verdict_id(decision.began_ns)
        stamp = self._stamp(judgement.at_ns)
        return verdict_of(ground.judgement, end.judgement, decision, contributed, verdict_id, stamp)

    def _contributions(self, ground: _Ground, decision: Decision) -> Mapping[str, Contribution] | None:
        if isinstance(ground.judgement, VerdictMessage):
            return ground.judgement.contributions
        asked = (ground.judgement.at_ns, decision.label)
        if self._contributed[0] != asked:
            label = None if decision.label == ABSTAIN else self.vocabulary.index(decision.label)
            prior, temperature = self._roster.prior, self._config.temperature
            told = contributions(self._rule, ground.opinions, prior, temperature, label)
            # Said twice, when it is decided and when it has ended; leaving out each judge in turn takes its time.
            self._contributed = asked, told
        return self._contributed[1]


def _decided(said: OngoingMovement | VerdictMessage) -> tuple[int, Decision | None]:
    """The movement as the judge has it: when it began, and what was decided of it so far."""
    if said.label is None or said.decided_ns is None:
        return said.began_ns, None
    return said.began_ns, Decision(said.label, said.began_ns, said.decided_ns)


def _rest(opinions: Sequence[AgedPosterior]) -> float:
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
