"""The fusion engine: posteriors of one scene in, judgements and verdicts out. Pure: time is passed in.

The design: fusion.md. Times are ns of the Unix epoch by the fusion machine's clock.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from common import SECOND_NS
from common.config_sections import FusionConfig
from common.message_types import LAST_INTEGER
from common.messages import WHY_LIMIT, JudgementMessage, PosteriorMessage, VerdictMessage
from common.vocabulary import ABSTAIN, Vocabulary
from fusion.engine.messages import JudgementBuilder, PublishedFacets, Stamp, published_facets
from fusion.engine.pooling import FACETS_NS, PooledPosterior, PoolingCase, newest_capture_ns, pool_facets, pool_steps
from fusion.engine.rest import RestPool
from fusion.engine.roster import AgedPosterior, Roster
from fusion.engine.rules import get_rule
from fusion.engine.segmenter import Segmenter
from fusion.engine.segments import MovementDecision, PooledState, last_capture_ns, pooled_repetitions
from fusion.engine.trust import Reliability, learn_from_verdict
from fusion.engine.verdicts import (
    CONTESTED_REST,
    NO_BASES,
    NearestMiss,
    VerdictBasis,
    build_verdict,
    contributions,
    explain_undecided,
    progress_of,
    with_score,
)


@dataclass(slots=True)
class EngineOutput:
    """The messages of one step."""

    judgement: JudgementMessage
    verdicts: Sequence[VerdictMessage]


class FusionEngine:
    """Fuses the posteriors of one scene's observers, which its `roster` has. Raises BadInput for an unknown rule.

    Each message carries `person`, who is judged, and what the caller sets: `epoch`, of the owner, `session`, random per
    process, and `place`, where the person stands.
    """

    def __init__(
        self, scene: str, observers: list[str], vocabulary: Vocabulary, config: FusionConfig, person: str | None = None
    ) -> None:
        self.vocabulary, self.person = vocabulary, person
        self.epoch: int | None = None
        self.session: str | None = None
        self.place: Sequence[float] | None = None
        self._scene, self._config, self._rule = scene, config, get_rule(config.rule)
        self.roster = Roster(observers, vocabulary, config)
        self._segmenter, self._rest = Segmenter(config, vocabulary), RestPool()
        self._builder = JudgementBuilder(scene, vocabulary, self._rule.name, person)
        self._bases: Mapping[int, VerdictBasis] = NO_BASES
        self._last_observed: tuple[PooledState, VerdictBasis] | None = None
        """The last step, if an observer saw somebody in it."""
        self._nearest, self._withheld, self._seq, self._facets_ns = NearestMiss(), list[VerdictMessage](), 0, 0
        self._facets: PublishedFacets = {}
        self.reliability = Reliability()

    def receive(self, observer: str, message: PosteriorMessage, now_ns: int) -> str | None:
        """Take one posterior that arrived at `now_ns`; returns why it was not used, or None."""
        return self.roster.receive(observer, message, now_ns)

    @property
    def reliability(self) -> Reliability:
        """Reliability of the observers, learned from verdicts; set it after a restart."""
        return self._reliability

    @reliability.setter
    def reliability(self, reliability: Reliability) -> None:
        self._reliability = reliability
        self.roster.set_reliability(reliability)

    def wait_for_roster(self, grace_s: float) -> None:
        """Withhold verdicts until all observers have begun, at most `grace_s` seconds after the first one."""
        self._segmenter.wait(grace_s)

    def change_vocabulary(self, vocabulary: Vocabulary, now_ns: int) -> Sequence[VerdictMessage]:
        """Fuse posteriors in `vocabulary` from now on; returns the end of a decided movement, in the old one.

        A movement that is not decided yet gets no verdict. What was learned about the observers' models is forgotten.
        """
        decision, verdicts = self._segmenter.end_now(now_ns), list[VerdictMessage]()
        if decision is not None and (basis := self._bases.get(decision.decided_ns)) is not None:
            stamp = {**self._stamp(now_ns), "seq": self._seq + 1}
            verdicts = [self._verdict(now_ns, decision, {now_ns: basis}, stamp)]
        self.roster.change_vocabulary(vocabulary)
        self.take_times(vocabulary)
        self._builder = JudgementBuilder(self._scene, vocabulary, self._rule.name, self.person)
        self._bases, self._last_observed, self._nearest = NO_BASES, None, NearestMiss()
        self.reliability = Reliability()
        self._segmenter.wait(0)
        return self._released(verdicts)

    def take_times(self, vocabulary: Vocabulary) -> None:
        """Take the durations of movements in `vocabulary`, which has the same labels."""
        self._segmenter.change_vocabulary(vocabulary)
        self.vocabulary = vocabulary

    def step(self, now_ns: int) -> EngineOutput:
        """Fuse the posteriors at `now_ns` to a judgement, and a verdict if one is due."""
        case = self.pooling_case(now_ns)
        return self.output_for(case.posteriors, now_ns, *pool_steps([case]))

    def pooling_case(self, now_ns: int) -> PoolingCase:
        """The case to pool at `now_ns`, for many scenes that are pooled together; `output_for` takes the result."""
        return self._case(self.roster.posteriors(now_ns, self._rest.reliability), now_ns)

    def output_for(
        self, posteriors: Sequence[AgedPosterior], now_ns: int, pooled: PooledPosterior | None = None
    ) -> EngineOutput:
        """Same as `step`, for posteriors recorded earlier: one for each observer, in the order of the roster.

        pooled: the result of pooling them, if it is known.
        """
        pooled = pooled or pool_steps([self._case(posteriors, now_ns)])[0]
        if pooled.facets is not None:
            self._facets, self._facets_ns = published_facets(pooled.facets), now_ns
        rest = self._rest.pool(posteriors, now_ns)
        ballot = self._builder.ballot(posteriors, pooled, self._rest.reliability)
        unlearned, observed = pooled.unlearned or 0.0, any(each.sees for each in posteriors)
        waits, is_periodic = self._segmenter.waits, self._segmenter.lasting(ballot.label).periodic
        missing = [each.observer for each in posteriors if waits and each.age_s is None and each.state == "silent"]
        counting = [each for each in posteriors if is_periodic and ballot.votes[each.observer].label == ballot.label]
        state = PooledState(
            now_ns, ballot.label, ballot.p * (1.0 - unlearned), ballot.agreement.k, rest, unlearned, observed,
            newest_capture_ns(posteriors, now_ns), not missing, pooled_repetitions(counting), ballot.contested,
        )  # fmt: skip
        # Before the first posterior, as after a restart during a movement, the absence of motion means nothing.
        has_posterior = observed or any(posterior.age_s is not None for posterior in posteriors)
        # Nobody is seen any more, as after a film: the last observed state ends in rest, because nothing follows.
        last = None if observed else self._last_observed
        shown = state if last is None else replace(last[0], at_ns=now_ns, rest=1.0, observed=False)
        decisions = self._segmenter.update(shown) if has_posterior else ()
        self._seq += 1
        progress = self._segmenter.shown
        began_ns = now_ns if progress is None else progress.began_ns
        is_moving = progress is not None or (observed and (state.rest < 0.5 or self._rest.contested))
        why = self._why(state, ballot.agreement.n, began_ns, missing) if is_moving or decisions else None
        stamp = self._stamp(now_ns)
        judgement = self._builder.judgement(
            ballot, pooled, self._facets, progress, why if is_moving else None, self.place, stamp
        )
        current = VerdictBasis(judgement, posteriors, why)
        basis = current if last is None else last[1]
        self._last_observed = (state, current) if observed else None
        verdicts = self._verdicts(now_ns, decisions, basis)
        self.roster.compare(judgement.movement, now_ns)
        return EngineOutput(judgement, self._released(verdicts))

    def continue_from(self, judgement: JudgementMessage) -> None:
        """Continue from the number and the movement of another service's message; from a verdict also with its basis.

        A message from before a change of vocabulary gives its number alone, because its movement has ended.
        """
        # A number near the end of its range would leave none for the next judgements.
        self._seq = judgement.seq if judgement.seq < LAST_INTEGER // 2 else 0
        self._segmenter.wait(0)
        # What this engine decided while it waited for observers, the other service has decided.
        self._withheld.clear()
        if judgement.vocabulary.hash != self.vocabulary.digest:
            return
        if not isinstance(judgement, VerdictMessage):
            ongoing = judgement.movement
            movement = None if ongoing is None else progress_of(ongoing, judgement)
            self._segmenter.follow(movement, last_capture_ns(judgement), None if ongoing is None else ongoing.outage_ns)
            self._keep_bases(self._bases)
            return
        progress = None if judgement.ended_ns is not None else progress_of(judgement, judgement)
        self._segmenter.follow(progress, judgement.at_ns)
        self._keep_bases({**self._bases, judgement.decided_ns: VerdictBasis(judgement, why=judgement.why)})
        self.reliability = learn_from_verdict(self.reliability, judgement, self.vocabulary)

    def adopt(self, judgement: JudgementMessage) -> bool:
        """Continue the decided movement of a service that stands by from now on.

        Returns False, and changes nothing, if this engine has decided a movement itself, or the judgement has none, or
        it is in another vocabulary.
        """
        own, movement = self._segmenter.movement, judgement.movement
        decided = own is not None and own.decision is not None
        if decided or movement is None or movement.label is None or judgement.vocabulary.hash != self.vocabulary.digest:
            return False
        self._segmenter.follow(progress_of(movement, judgement))
        return True

    def close(self, verdict: VerdictMessage, ended_ns: int, now_ns: int, same_as: str | None = None) -> VerdictMessage:
        """The last message on the movement of `verdict`. same_as: the id that another service gives it; "": none."""
        fields = {"same_as": same_as, "stage": "ended", "ended_ns": max(ended_ns, verdict.decided_ns)}
        return verdict.model_copy(update={**self._stamp(now_ns), **fields})

    def _case(self, posteriors: Sequence[AgedPosterior], now_ns: int | None = None) -> PoolingCase:
        with_facets = now_ns is None or abs(now_ns - self._facets_ns) >= FACETS_NS
        temperature, proven = self._config.temperature, self._reliability.proves
        return PoolingCase(self._rule, posteriors, self.roster.prior, temperature, with_facets, proven)

    def _verdicts(
        self, now_ns: int, decisions: Sequence[MovementDecision], basis: VerdictBasis
    ) -> list[VerdictMessage]:
        """The verdicts on what was decided now, based on `basis`; keeps the bases that later verdicts may need."""
        if not decisions and not self._segmenter.basis_times:
            self._bases = NO_BASES
            return []
        bases, verdicts, stamp = {**self._bases, now_ns: basis}, list[VerdictMessage](), self._stamp(now_ns)
        for decision in decisions:
            verdicts.append(verdict := with_score(self._verdict(now_ns, decision, bases, stamp), basis.posteriors))
            self.reliability = learn_from_verdict(self.reliability, verdict, self.vocabulary)
            # It carries the contributions, which take long to compute, to its next publication.
            bases[verdict.decided_ns] = VerdictBasis(verdict, why=verdict.why)
        self._keep_bases(bases)
        return verdicts

    def _keep_bases(self, bases: Mapping[int, VerdictBasis]) -> None:
        self._bases = {at_ns: bases[at_ns] for at_ns in self._segmenter.basis_times if at_ns in bases}

    def _stamp(self, at_ns: int) -> Stamp:
        own = self._config.id
        return {"fusion": own, "seq": self._seq, "at_ns": at_ns, "epoch": self.epoch, "session": self.session}

    def _released(self, verdicts: Sequence[VerdictMessage]) -> Sequence[VerdictMessage]:
        """The verdicts to publish now: none while the service waits for observers, then also those of that time."""
        if self._segmenter.waits:
            self._withheld += verdicts
            return []
        released, self._withheld = [*self._withheld, *verdicts], []
        return released

    def _why(self, state: PooledState, observers: int, began_ns: int, missing: Sequence[str]) -> str | None:
        since_ns, moved_s = self._segmenter.held_since_ns, (state.at_ns - began_ns) / SECOND_NS
        held_s = None if since_ns is None else (state.at_ns - since_ns) / SECOND_NS
        why = explain_undecided(state, observers, held_s, moved_s, self._config)
        if self._rest.contested:
            # While the person rested when the two last agreed, no label is wanted.
            why = CONTESTED_REST if why is None or state.rests else f"{CONTESTED_REST}; {why}"[:WHY_LIMIT]
        is_nearer = began_ns != self._nearest.began_ns or state.p > self._nearest.p
        if is_nearer and self._segmenter.movement is not None:
            self._nearest = NearestMiss(began_ns, state.p, why)
        if self._segmenter.waits and observers:
            return f"waiting for {', '.join(missing)} to begin"[:WHY_LIMIT]
        return why

    def _verdict(
        self, now_ns: int, decision: MovementDecision, bases: Mapping[int, VerdictBasis], stamp: Stamp
    ) -> VerdictMessage:
        """The verdict with its basis: the votes that decided it, also when its end is published.

        The votes of an abstention are those at the end of the movement; after it, the posteriors fade.
        """
        basis_ns = decision.ended_ns if decision.label == ABSTAIN else decision.decided_ns
        basis = bases.get(basis_ns or 0, bases[now_ns])
        end = bases.get(decision.ended_ns or 0, basis)
        why = basis.why if decision.label == ABSTAIN else None
        if why is not None and decision.revises is None and self._nearest.began_ns == decision.began_ns:
            why = self._nearest.why
        if isinstance(basis.judgement, VerdictMessage):
            contributed = basis.judgement.contributions
        else:
            index = None if decision.label == ABSTAIN else self.vocabulary.index(decision.label)
            contributed = contributions(self._case(basis.posteriors), index)
        facets: PublishedFacets | None = end.judgement.facets
        if end.posteriors:
            # Those of a judgement are up to FACETS_NS older.
            facets = published_facets(pool_facets([self._case(end.posteriors)])[0], facets)
        fields = {**stamp, "id": self._builder.verdict_id(decision.began_ns), "why": why, "contributions": contributed}
        at_end = {"facets": facets or None, "facing_deg": end.judgement.facing_deg}
        return build_verdict(basis.judgement, decision, {**fields, **at_end})
