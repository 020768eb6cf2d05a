"""Judging a capture anew from its judgements, step by step. Pure.

1. A recorded judgement holds every vote as it was pooled: the referee rules on those again, at that time. So a
   replay is exact, whatever the network did between the observers and the referee.
2. A fusion service that takes over goes on from what the last one said, as it did then; one that was started anew
   does so without what the judge before had held in mind.
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from common.errors import BadInput, LabanmeshError
from common.messages import JudgementMessage, OngoingMovement, VerdictMessage, Vote
from common.probability import Floats, uniform
from common.vocabulary import Vocabulary
from fusion.engine.engine import EngineOutput, FusionEngine
from fusion.engine.roster import AgedPosterior

if TYPE_CHECKING:
    from common.config import FusionConfig, Scene


@dataclass(frozen=True, slots=True)
class Change:
    """What is to be otherwise than it was: observers left out, another rule, quorum or threshold; None as it was."""

    without: tuple[str, ...] = ()
    rule: str | None = None
    quorum: int | None = None
    threshold: float | None = None

    @property
    def any(self) -> bool:
        """Whether anything is."""
        return self != Change()

    def remaining(self, observers: Iterable[str]) -> tuple[str, ...]:
        """Those of `observers` who are not left out, in their order."""
        return tuple(observer for observer in observers if observer not in self.without)

    def conduct(self, fusion: "FusionConfig", observers: int) -> "FusionConfig":
        """How the referee then judges; the quorum is at most the number of those who remain."""
        quorum = min(self.quorum or fusion.quorum, observers)
        rule, threshold = self.rule or fusion.rule, self.threshold or fusion.threshold
        return fusion.model_copy(update={"quorum": quorum, "rule": rule, "threshold": threshold})

    def check(self, roster: Iterable[str]) -> None:
        """Raises BadInput for an observer who is not of the scene, and when nobody or too few would remain."""
        known = tuple(roster)
        for observer in self.without:
            if observer not in known:
                raise BadInput(f"--without {observer}: not in the scene; known: {', '.join(known)}")
        left = len(self.remaining(known))
        if not left:
            raise BadInput("--without: nobody would remain to judge; leave at least one observer in")
        if self.quorum is not None and self.quorum > left:
            raise BadInput(f"--quorum {self.quorum}: {left} observers judge, so many can never agree; 1 to {left}")


class FromJudgements:
    """The recorded judgements, each ruled on again.

    `unsure`: spans of time, first and last ns, in which something happened that is not in the file: before a capture
    that began in the middle, around judgements that it did not hear (`missing` many), where another service took over.
    A movement that was under way then goes on as it is recorded, for what the judge had in mind is not.
    """

    def __init__(self, scene: "Scene", labels: Mapping[str, tuple[str, ...]], change: Change) -> None:
        self._scene, self._labels, self._change = scene, labels, change
        self._referee: FusionEngine | None = None
        self._last: JudgementMessage | None = None
        self._verdict: VerdictMessage | None = None
        self._restarted = False
        self.unsure: list[tuple[int, int]] = []
        self.missing = 0

    def remember(self, verdict: VerdictMessage) -> None:
        """A recorded verdict: on its grounds a movement that is under way may end."""
        self._verdict = verdict

    def gone(self, fusion: str) -> None:
        """A fusion service was seen to go; if it speaks again it was started anew."""
        self._restarted |= self._last is not None and self._last.fusion == fusion

    def rule_on(self, judgement: JudgementMessage) -> EngineOutput | None:
        """The judgement anew; None for the first of a capture that began in the middle of things."""
        last, self._last = self._last, judgement
        begins, faithful = judgement.seq == 1, not self._change.any
        if self._referee is None or last is None or self._is_new(judgement, last):
            self._referee = self._referee_for(judgement)
            goes_on = not begins
        else:
            goes_on = judgement.seq != last.seq + 1 or judgement.fusion != last.fusion
        if goes_on:
            self.unsure.append((last.at_ns if last else 0, judgement.at_ns))
        if last is None and goes_on and faithful:
            self._continue(self._referee, judgement, judgement.seq)
            return None
        if last is not None:
            self.missing += max(judgement.seq - last.seq - 1, 0)
            if goes_on and faithful:
                self._continue(self._referee, last, judgement.seq - 1)
        ruling = self._ruling(self._referee, judgement)
        if faithful and self._is_only_recorded(judgement.movement, ruling.judgement.movement):
            self._continue(self._referee, judgement, judgement.seq)
        return ruling

    def _is_only_recorded(self, recorded: OngoingMovement | None, judged: OngoingMovement | None) -> bool:
        """Whether a movement goes on otherwise than it was recorded, and can, because not all of it is in the file."""
        began_ns = [movement.began_ns for movement in (recorded, judged) if movement is not None]
        return recorded != judged and bool(self.unsure) and min(began_ns) <= self.unsure[-1][1]

    def _is_new(self, judgement: JudgementMessage, last: JudgementMessage) -> bool:
        """Whether another referee judges than before; who stood by had the same in mind (rule 2)."""
        restarted, self._restarted = self._restarted, False
        if _terms(judgement) != _terms(last):
            return True
        again = judgement.seq == 1 or (restarted and judgement.fusion == last.fusion)
        return again and not self._change.any

    def _referee_for(self, judgement: JudgementMessage) -> FusionEngine:
        reference = judgement.vocabulary
        vocabulary = Vocabulary(labels_of(reference.hash, self._labels), reference.name)
        observers = self._change.remaining(judgement.votes)
        if not observers:
            raise BadInput("--without: nobody would remain to judge; leave at least one observer in")
        # The rule as it was said to be: the environment may have overridden the scene file.
        said = self._scene.fusion.model_copy(update={"rule": judgement.rule})
        return FusionEngine(judgement.scene, list(observers), vocabulary, self._change.conduct(said, len(observers)))

    def _continue(self, referee: FusionEngine, judgement: JudgementMessage, seq: int) -> None:
        under_way, decided = judgement.movement, self._verdict
        if under_way is not None and decided is not None and decided.id == under_way.id:
            referee.continue_from(decided)
        referee.continue_from(judgement.model_copy(update={"seq": seq}))

    def _ruling(self, referee: FusionEngine, judgement: JudgementMessage) -> EngineOutput:
        prior = uniform(referee.vocabulary.size)
        remaining = self._change.remaining(judgement.votes)
        heard = [_opinion(o, judgement.votes[o], prior, remaining) for o in remaining]
        ruling = referee.output_for(heard, judgement.at_ns)
        named = {"fusion": judgement.fusion}
        verdicts = [verdict.model_copy(update=named) for verdict in ruling.verdicts]
        return EngineOutput(ruling.judgement.model_copy(update=named), verdicts)


def _opinion(observer: str, vote: Vote, prior: Floats, remaining: Collection[str]) -> AgedPosterior:
    """The judge as he was pooled, among those who remain: one who said nothing was the prior."""
    p = prior if vote.p is None else np.array(vote.p)
    if p.shape != prior.shape or not np.isfinite(p).all():
        raise LabanmeshError(
            f"a judgement cannot be judged anew: the vote of {observer} is no belief over its vocabulary"
        )
    rest = 1.0 if vote.rest is None else vote.rest
    facets = {name: np.array(said) for name, said in (vote.facets or {}).items()}
    surprise = None if vote.facing is None else np.array(vote.facing.surprise)
    if surprise is not None and len(surprise) != len(prior):
        raise LabanmeshError(f"a judgement cannot be judged anew: the facing of {observer} is of another vocabulary")
    reliability = 1.0 if vote.reliability is None else vote.reliability
    correlations = {other: share for other, share in (vote.doubles or {}).items() if other in remaining}
    said_last = (vote.unlearned, surprise, facets, reliability, correlations)
    return AgedPosterior(observer, p, rest, vote.age_s, vote.state, vote.skew_s, *said_last)


def _terms(judgement: JudgementMessage) -> tuple[object, ...]:
    """What cannot change without another referee."""
    return judgement.rule, judgement.vocabulary, tuple(judgement.votes)


def labels_of(digest: str, labels: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    """The movements of the vocabulary with that hash; raises LabanmeshError that says why they are not known."""
    if digest not in labels:
        raise LabanmeshError(
            f"the names of the movements (vocabulary {digest}) are not in the capture: nobody who knew them answered "
            "while it was made; name them as `vocabulary` in the scene file and capture again"
        )
    return labels[digest]
