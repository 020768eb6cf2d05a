"""Judges a capture again from its recorded judgements, step by step. Pure.

1. A recorded judgement contains every vote as it was pooled, and the engine fuses these votes again at the recorded
   time. The replay is therefore exact, whatever the network did between observers and fusion.
2. A fusion service that takes over continues from the last published judgement, as it did live. A service that was
   restarted continues too, but without the internal state of its predecessor.
3. Votes carry no scores, so an ended verdict has its recorded ones, and after a change none.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from common.errors import BadInput, LabanmeshError
from common.fusion_rules import DEFAULT_RULE, RETIRED_RULES
from common.messages import JudgementMessage, OngoingMovement, VerdictMessage, Vote
from common.posterior import Repeated
from common.probability import Floats, uniform
from common.text import plural
from common.vocabulary import Vocabulary
from studies.fusion_engine import POOLED_STATES, AgedPosterior, EngineOutput, FusionEngine, get_rule

if TYPE_CHECKING:
    from common.config import FusionConfig, Scene

NOBODY_LEFT = "--without: no observer would be left; leave out fewer"
SCORE_FIELDS = ("score", "scores", "remarks")
Vocabularies = Mapping[str, Vocabulary]
"""The movements of each vocabulary, by its hash."""


@dataclass(frozen=True, slots=True)
class ReplayChange:
    """What differs from the recorded run: observers left out, another rule, quorum or threshold; None: as recorded.

    gone: the recorded rule, if it does not exist any more.
    """

    without: tuple[str, ...] = ()
    rule: str | None = None
    quorum: int | None = None
    threshold: float | None = None
    gone: str | None = None

    @property
    def any(self) -> bool:
        """Whether anything differs."""
        return self != ReplayChange()

    def remaining(self, observers: Iterable[str]) -> tuple[str, ...]:
        """The observers that are not left out, in their order."""
        return tuple(observer for observer in observers if observer not in self.without)

    def in_place_of(self, recorded: str) -> "ReplayChange":
        """The change that also takes the default rule in place of a recorded rule that is gone."""
        return replace(self, rule=DEFAULT_RULE, gone=recorded) if not self.rule and recorded in RETIRED_RULES else self

    def config(self, fusion: "FusionConfig", observers: int) -> "FusionConfig":
        """The changed settings; the quorum is at most the number of remaining observers."""
        quorum = min(self.quorum or fusion.quorum, observers)
        rule, threshold = self.rule or fusion.rule, self.threshold or fusion.threshold
        return fusion.model_copy(update={"quorum": quorum, "rule": rule, "threshold": threshold})

    def check(self, roster: Iterable[str]) -> None:
        """Raises BadInput for an observer that is not in the scene, and when too few observers remain."""
        known = tuple(roster)
        if self.rule is not None:
            get_rule(self.rule, "--rule")
        for observer in self.without:
            if observer not in known:
                raise BadInput(f"--without {observer}: not in the scene; known: {', '.join(known)}")
        left = len(self.remaining(known))
        if not left:
            raise BadInput(NOBODY_LEFT)
        if self.quorum is not None and self.quorum > left:
            raise BadInput(f"--quorum {self.quorum}: only {plural(left, 'observer')}; choose 1 to {left}")


@dataclass(frozen=True, slots=True)
class Gap:
    """Time, in ns since 1970, in which something happened that the capture does not contain."""

    first_ns: int
    last_ns: int


class JudgementReplay:
    """Fuses the recorded judgements on one person again, one after the other.

    `gaps`: before a capture that began in the middle, around judgements that it missed (`missing` many), and where
    another service took over. A movement that was under way then continues as recorded, because the internal state of
    the verdict detector is not in the capture.
    """

    def __init__(self, scene: "Scene", vocabularies: Vocabularies, change: ReplayChange) -> None:
        self._scene, self._vocabularies, self._change = scene, vocabularies, change
        self._engine: FusionEngine | None = None
        self._last: JudgementMessage | None = None
        self._verdict: VerdictMessage | None = None
        self._scores: dict[str, object] = {}
        self._restarted = False
        self.gaps: list[Gap] = []
        self.missing = 0

    def set_verdict(self, verdict: VerdictMessage) -> None:
        """Take note of a recorded verdict: a movement under way may end with its votes."""
        self._verdict = verdict
        if verdict.score is not None:
            self._scores = {name: getattr(verdict, name) for name in ("id", "stage", *SCORE_FIELDS)}

    def set_times(self, published: Vocabulary) -> None:
        """Take the durations of movements that the service has published."""
        digest, engine = published.digest, self._engine
        self._vocabularies = {**self._vocabularies, digest: published}
        if engine is not None and engine.vocabulary.digest == digest:
            engine.take_times(replace(engine.vocabulary, movements=published.movements))

    def set_gone(self, fusion: str) -> None:
        """Take note that a fusion service ended; if it publishes again, it was restarted."""
        self._restarted |= self._last is not None and self._last.fusion == fusion

    def fuse(self, judgement: JudgementMessage) -> EngineOutput | None:
        """Fuse one recorded judgement again; None for the first one of a capture that began in the middle."""
        last, self._last = self._last, judgement
        faithful = not self._change.any
        if self._engine is None or last is None or self._is_new(judgement, last):
            self._engine = self._engine_for(judgement)
            continues = judgement.seq != 1
        else:
            continues = judgement.seq != last.seq + 1 or judgement.fusion != last.fusion
        if continues:
            self.gaps.append(Gap(last.at_ns if last else 0, judgement.at_ns))
        if last is None and continues and faithful:
            self._continue(self._engine, judgement, judgement.seq)
            return None
        if last is not None:
            self.missing += max(judgement.seq - last.seq - 1, 0)
            if continues and faithful:
                self._continue(self._engine, last, judgement.seq - 1)
        output = self._output(self._engine, judgement)
        if faithful and self._is_only_recorded(judgement.movement, output.judgement.movement):
            self._continue(self._engine, judgement, judgement.seq)
        return output

    def _is_only_recorded(self, recorded: OngoingMovement | None, replayed: OngoingMovement | None) -> bool:
        """Whether the movement differs from the recorded one because part of it is in a gap."""
        began_ns = [movement.began_ns for movement in (recorded, replayed) if movement is not None]
        return recorded != replayed and bool(self.gaps) and min(began_ns) <= self.gaps[-1].last_ns

    def _is_new(self, judgement: JudgementMessage, last: JudgementMessage) -> bool:
        """Whether another engine is needed; a standby that takes over has the same state (rule 2)."""
        restarted, self._restarted = self._restarted, False
        if _engine_settings(judgement) != _engine_settings(last):
            return True
        again = judgement.seq == 1 or (restarted and judgement.fusion == last.fusion)
        return again and not self._change.any

    def _engine_for(self, judgement: JudgementMessage) -> FusionEngine:
        reference = judgement.vocabulary
        vocabulary = replace(vocabulary_of(reference.hash, self._vocabularies), name=reference.name)
        observers = self._change.remaining(judgement.votes)
        if not observers:
            raise BadInput(NOBODY_LEFT)
        # The rule of the judgement: the environment may have overridden the scene file.
        config = self._scene.fusion.model_copy(update={"rule": judgement.rule})
        changed = self._change.config(config, len(observers))
        engine = FusionEngine(judgement.scene, list(observers), vocabulary, changed, judgement.person)
        # A capture from before there was this key has verdicts that did not wait.
        if judgement.seq == 1 and "start_s" in config.model_fields_set:
            engine.wait_for_roster(config.start_s)
        return engine

    def _continue(self, engine: FusionEngine, judgement: JudgementMessage, seq: int) -> None:
        ongoing, decided = judgement.movement, self._verdict
        if ongoing is not None and decided is not None and decided.id == ongoing.id:
            engine.continue_from(decided)
        engine.continue_from(judgement.model_copy(update={"seq": seq}))

    def _output(self, engine: FusionEngine, judgement: JudgementMessage) -> EngineOutput:
        prior = uniform(engine.vocabulary.size)
        remaining = self._change.remaining(judgement.votes)
        posteriors = [_posterior(o, judgement.votes[o], prior) for o in remaining]
        engine.place = judgement.place
        output = engine.output_for(posteriors, judgement.at_ns)
        sender = {"fusion": judgement.fusion, "epoch": judgement.epoch, "session": judgement.session}
        verdicts = [verdict.model_copy(update=sender | self._scores_of(verdict)) for verdict in output.verdicts]
        return EngineOutput(output.judgement.model_copy(update=sender), verdicts)

    def _scores_of(self, verdict: VerdictMessage) -> dict[str, object]:
        """The recorded scores of a verdict (rule 3)."""
        is_same = (self._scores.get("id"), self._scores.get("stage")) == (verdict.id, verdict.stage)
        return {name: self._scores[name] for name in SCORE_FIELDS} if is_same and not self._change.any else {}


def _posterior(observer: str, vote: Vote, prior: Floats) -> AgedPosterior:
    """The vote as it was pooled; the prior for an observer without a posterior."""
    p = prior if vote.p is None else np.array(vote.p)
    if p.shape != prior.shape or not np.isfinite(p).all():
        raise LabanmeshError(
            f"cannot judge a judgement again: the vote of {observer} is no distribution over its vocabulary"
        )
    surprise = None if vote.facing is None else np.array(vote.facing.surprise)
    if surprise is not None and len(surprise) != len(prior):
        raise LabanmeshError(f"cannot judge a judgement again: the facing of {observer} has another vocabulary")
    return AgedPosterior(
        observer,
        p,
        1.0 if vote.rest is None else vote.rest,
        vote.age_s,
        vote.state,
        vote.skew_s,
        vote.unlearned,
        surprise,
        vote.facets or {},
        1.0 if vote.reliability is None else vote.reliability,
        1.0 if vote.freshness is None else vote.freshness,
        vote.repetitions,
        repeated=None
        if (repeated := vote.repeated) is None
        else Repeated(partial=repeated.partial, swing=repeated.swing),
        sees=vote.state in POOLED_STATES and vote.rest is not None,
    )


def _engine_settings(judgement: JudgementMessage) -> tuple[object, ...]:
    """The settings that only another engine can have."""
    return judgement.rule, judgement.vocabulary, tuple(judgement.votes)


def vocabulary_of(digest: str, vocabularies: Vocabularies) -> Vocabulary:
    """The vocabulary with that hash; raises LabanmeshError when they are not in the capture."""
    if digest not in vocabularies:
        raise LabanmeshError(
            f"the names of the movements (vocabulary {digest}) are not in the capture: no process answered the request "
            "for them; set `vocabulary` in the scene file and capture again"
        )
    return vocabularies[digest]
