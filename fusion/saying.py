"""From what was pooled to the messages that say it: votes, judgements, verdicts. Pure."""

from collections.abc import Mapping, Sequence

import numpy as np

from common.messages import Agreement, Contribution, Facing, JudgementMessage, VerdictMessage, VocabularyReference, Vote
from common.probability import Floats, entropy_bits
from common.vocabulary import Vocabulary
from fusion.judge import Decision
from fusion.pooling import FACING, Pool, facing_deg
from fusion.roster import HEARD, Opinion

KNOWS_NOTHING = 0.01
"""A belief that differs by no more than this from the prior holds no label."""
TABLE_LIMIT = 8192
"""So many cells of all judges' facings are said in the votes; more would not fit into a message."""


class Scribe:
    """Puts one fusion service's judgements into words."""

    def __init__(self, scene: str, fusion: str, vocabulary: Vocabulary, prior: Floats, rule: str) -> None:
        self._scene, self._fusion, self._vocabulary, self._prior, self._rule = scene, fusion, vocabulary, prior, rule
        self._reference = VocabularyReference(name=vocabulary.name, hash=vocabulary.digest)

    def judgement(
        self, opinions: Sequence[Opinion], pooled: Pool, facets: Mapping[str, Floats], seq: int, now_ns: int
    ) -> JudgementMessage:
        """What the judges together believe, and each of them."""
        label = self._vocabulary.labels[int(pooled.p.argmax())]
        votes = self._votes(opinions, pooled.weights)
        heard = [vote for vote in votes.values() if vote.state in HEARD]
        told = {name: p.tolist() for name, p in facets.items()}
        if pooled.facing is not None:
            told[FACING] = pooled.facing.tolist()
        return JudgementMessage(
            scene=self._scene,
            fusion=self._fusion,
            seq=seq,
            at_ns=now_ns,
            vocabulary=self._reference,
            p=pooled.p.tolist(),
            label=label,
            certainty_bits=float(entropy_bits(pooled.p)),
            rule=self._rule,
            votes=votes,
            agreement=Agreement(k=sum(vote.label == label for vote in heard), n=len(heard)),
            unlearned=pooled.unlearned,
            facets=told or None,
            facing_deg=None if pooled.facing is None else facing_deg(pooled.facing),
        )

    def _votes(self, opinions: Sequence[Opinion], weights: Floats) -> dict[str, Vote]:
        entropies = entropy_bits(np.array([o.p for o in opinions])).tolist()
        cells = sum(o.surprise.size for o in opinions if o.surprise is not None)
        told = zip(opinions, entropies, weights.tolist(), strict=True)
        return {o.observer: self._vote(o, entropy, weight, cells <= TABLE_LIMIT) for o, entropy, weight in told}

    def _vote(self, opinion: Opinion, entropy: float, weight: float, with_facing: bool) -> Vote:
        said, surprise = opinion.state in HEARD, opinion.surprise if with_facing else None
        return Vote(
            label=self._held(opinion) if said else None,
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
            doubles=dict(opinion.doubles) or None,
        )

    def _held(self, opinion: Opinion) -> str | None:
        # The likeliest label of who knows nothing is the first of the vocabulary, and no agreement with anybody.
        likeliest = int(opinion.p.argmax())
        knows = bool(np.abs(opinion.p - self._prior).max() > KNOWS_NOTHING)
        other = opinion.unlearned or 0.0
        return self._vocabulary.labels[likeliest] if knows and other <= opinion.p[likeliest] * (1 - other) else None


def verdict_of(
    ground: JudgementMessage,
    end: JudgementMessage,
    decision: Decision,
    contributed: Mapping[str, Contribution] | None,
    said: Mapping[str, object],
) -> VerdictMessage:
    """The `decision` in words that rest on `ground`; its facets are those of `end`. `said`: by whom, when, its id."""
    fields = {name: getattr(ground, name) for name in JudgementMessage.model_fields}
    told = {"facets": end.facets, "facing_deg": end.facing_deg, "movement": None, "label": decision.label}
    times = {"began_ns": decision.began_ns, "decided_ns": decision.decided_ns, "ended_ns": decision.ended_ns}
    return VerdictMessage.model_validate({**fields, **told, **times, **said, "contributions": contributed})
