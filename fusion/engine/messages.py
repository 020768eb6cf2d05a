"""From what was pooled to the messages that say it: votes, judgements, verdicts. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from common.messages import (
    Agreement,
    Contribution,
    Facing,
    JudgementMessage,
    OngoingMovement,
    VerdictMessage,
    VocabularyReference,
    Vote,
)
from common.probability import Floats, entropy_bits
from common.vocabulary import Vocabulary
from fusion.engine.pooling import FACING, PooledPosterior, facing_deg
from fusion.engine.roster import HEARD, AgedPosterior
from fusion.engine.verdict_detector import Decision

KNOWS_NOTHING = 0.01
"""A belief that differs by no more than this from the prior holds no label."""
TABLE_LIMIT = 8192
"""So many cells of all judges' facings are said in the votes; more would not fit into a message."""


@dataclass(frozen=True, slots=True)
class View:
    """What was pooled, as people count: the likeliest label, how likely, the judges' votes, how many of them agree."""

    label: str
    p: float
    votes: dict[str, Vote]
    agreement: Agreement


@dataclass(frozen=True, slots=True)
class Stamp:
    """Which fusion service publishes a message, in which epoch and session, with which number, and when."""

    fusion: str
    seq: int
    at_ns: int
    epoch: int | None = None
    session: str | None = None

    def fields(self) -> dict[str, Any]:
        """The fields of the message, by name."""
        return asdict(self)


class JudgementBuilder:
    """Puts one fusion service's judgements into words."""

    def __init__(self, scene: str, vocabulary: Vocabulary, prior: Floats, rule: str) -> None:
        self._scene, self._vocabulary, self._prior, self._rule = scene, vocabulary, prior, rule
        self._reference = VocabularyReference(name=vocabulary.name, hash=vocabulary.digest)

    def view(self, opinions: Sequence[AgedPosterior], pooled: PooledPosterior) -> View:
        """The likeliest movement, each judge's vote, and who agrees."""
        likeliest = int(pooled.p.argmax())
        votes = self._votes(opinions, pooled.weights)
        counted = [vote for vote in votes.values() if vote.state in HEARD]
        # With no vote, the pooled posterior is the prior, and its first label would be nobody's.
        label = self._vocabulary.labels[likeliest] if counted else ""
        heard = [vote.label == label for vote in counted]
        return View(label, float(pooled.p[likeliest]), votes, Agreement(k=sum(heard), n=len(heard)))

    def judgement(
        self,
        view: View,
        pooled: PooledPosterior,
        facets: Mapping[str, Floats],
        movement: OngoingMovement | None,
        stamp: Stamp,
    ) -> JudgementMessage:
        """What the judges together believe, and each of them."""
        told = {name: p.tolist() for name, p in facets.items()}
        if pooled.facing is not None:
            told[FACING] = pooled.facing.tolist()
        return JudgementMessage(
            scene=self._scene,
            **stamp.fields(),
            vocabulary=self._reference,
            p=pooled.p.tolist(),
            label=view.label,
            certainty_bits=float(entropy_bits(pooled.p)),
            rule=self._rule,
            votes=view.votes,
            agreement=view.agreement,
            unlearned=pooled.unlearned,
            facets=told or None,
            facing_deg=None if pooled.facing is None else facing_deg(pooled.facing),
            movement=movement,
        )

    def _votes(self, opinions: Sequence[AgedPosterior], weights: Floats) -> dict[str, Vote]:
        rows = np.array([o.p for o in opinions])
        cells = sum(o.surprise.size for o in opinions if o.surprise is not None)
        said = zip(opinions, entropy_bits(rows).tolist(), weights.tolist(), self._held(opinions, rows), strict=True)
        return {o.observer: self._vote(o, bits, weight, held, cells <= TABLE_LIMIT) for o, bits, weight, held in said}

    def _vote(self, opinion: AgedPosterior, entropy: float, weight: float, held: str | None, with_facing: bool) -> Vote:
        said, surprise = opinion.state in HEARD, opinion.surprise if with_facing else None
        return Vote(
            label=held if said else None,
            entropy=entropy if said else None,
            weight=weight,
            age_s=opinion.age_s,
            state=opinion.state,
            p=opinion.p.tolist() if said else None,
            rest=opinion.rest,
            skew_s=opinion.skew_s,
            unlearned=opinion.unlearned,
            facing=None if surprise is None else Facing.model_construct(surprise=surprise.tolist()),
            facets={name: p.tolist() for name, p in opinion.facets.items()} or None,
            reliability=opinion.reliability,
            doubles=dict(opinion.correlations) or None,
        )

    def _held(self, opinions: Sequence[AgedPosterior], rows: Floats) -> list[str | None]:
        """Each one's label; rows (N, M) what they believe."""
        # The likeliest label of who knows nothing is the first of the vocabulary, and no agreement with anybody.
        knows = (np.abs(rows - self._prior).max(axis=1) > KNOWS_NOTHING).tolist()
        other = [o.unlearned or 0.0 for o in opinions]
        told = zip(rows.argmax(axis=1).tolist(), rows.max(axis=1).tolist(), knows, other, strict=True)
        return [self._vocabulary.labels[m] if knows and u <= p * (1 - u) else None for m, p, knows, u in told]


def verdict_of(
    ground: JudgementMessage,
    end: JudgementMessage,
    decision: Decision,
    contributed: Mapping[str, Contribution] | None,
    verdict_id: str,
    stamp: Stamp,
) -> VerdictMessage:
    """The `decision` in words that rest on `ground`; its facets are those of `end`."""
    fields = {name: getattr(ground, name) for name in JudgementMessage.model_fields}
    told = {"facets": end.facets, "facing_deg": end.facing_deg, "movement": None, "label": decision.label}
    times = {"began_ns": decision.began_ns, "decided_ns": decision.decided_ns, "ended_ns": decision.ended_ns}
    return VerdictMessage.model_validate(
        {**fields, **told, **times, **stamp.fields(), "id": verdict_id, "contributions": contributed}
    )
