"""Builds votes and judgements; verdicts.py builds verdicts of them. Pure.

Validation would take longer than pooling. `unchecked` therefore builds them from values that are in range already:
those of checked messages, and the engine's own, whose round-off is clamped here. Tests validate what is made.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from common import MS_NS
from common.message_types import CONTRADICTED, VotedFacing, VotedRepeated, unchecked
from common.messages import (
    SCHEMA_VERSION,
    Agreement,
    JudgementMessage,
    OngoingMovement,
    VocabularyReference,
    Vote,
)
from common.probability import Floats, roots_of
from common.vocabulary import Vocabulary
from common.wire import SIZE_LIMIT
from fusion.engine.guarded_product import NATS_TO_BITS, TINY
from fusion.engine.pooling import FACING, PooledPosterior, facing_deg
from fusion.engine.roster import POOLED_STATES, AgedPosterior
from fusion.engine.segments import MovementProgress, repetition_fields

PublishedFacets = Mapping[str, list[float]]
Stamp = Mapping[str, Any]
"""The fields of a message that say who publishes it, and when: fusion, seq, at_ns, epoch, session."""
LABEL_MARGIN = 0.01
"""A posterior that differs from the prior by no more than this in any probability votes for no label."""
FACING_CELLS_LIMIT = SIZE_LIMIT // 8
"""Cells (M, K), of up to two bytes, of all facings together that votes carry; more may not fit into a message."""


@dataclass(slots=True)
class Ballot:
    """The votes, the pooled posterior, and how many votes agree with its likeliest label.

    entropy: of `pooled`, bits. label: the likeliest, "" without a vote. p: its probability.
    contested: whether a trusted observer of three or more votes for another label. Of two observers this would show
    nothing, because the rule doubts neither. An observer that finds "something else" likelier contests nothing: it may
    see too little of the person.
    """

    votes: dict[str, Vote]
    pooled: list[float]
    entropy: float
    label: str
    p: float
    agreement: Agreement
    contested: bool


def published_facets(pooled: Mapping[str, Floats], judged: PublishedFacets | None = None) -> PublishedFacets:
    """Pooled facets as messages carry them, with the facing that was `judged`."""
    facets = {name: _in_range(p.tolist()) for name, p in pooled.items()}
    return {**facets, FACING: judged[FACING]} if judged and FACING in judged else facets


class JudgementBuilder:
    """Builds the votes and judgements of one scene. person: whom it is about, in a scene that judges several people."""

    def __init__(self, scene: str, vocabulary: Vocabulary, rule: str, person: str | None = None) -> None:
        self._labels, size = vocabulary.labels, vocabulary.size
        self._to_bits, self._most_bits = np.full(size, -NATS_TO_BITS), math.log2(size)
        reference = VocabularyReference(name=vocabulary.name, hash=vocabulary.digest)
        self._same = {"v": SCHEMA_VERSION, "scene": scene, "vocabulary": reference, "rule": rule, "person": person}
        self._progress: MovementProgress | None = None
        self._ongoing: OngoingMovement | None = None
        self._id_prefix = scene if person is None else f"{scene}-{person}"

    def ballot(
        self, posteriors: Sequence[AgedPosterior], pooled: PooledPosterior, resting: Mapping[str, float]
    ) -> Ballot:
        """Every observer's vote, and the fused label. resting: trust in the rest of the observers below full trust."""
        # (N + 1, M): the pooled posterior is the last row.
        rows, names = pooled.rows, self._labels
        *p, pooled_p = rows.tolist()
        *entropies, entropy = self._entropies(rows)
        *likeliest, pooled_likeliest = rows.argmax(axis=1).tolist()
        roots, weights = roots_of(rows[:-1]).tolist(), pooled.weights.tolist()
        tables = [each.surprise.size for each in posteriors if each.surprise is not None]
        with_facing = pooled.facing is not None and sum(tables) <= FACING_CELLS_LIMIT
        votes, labels, believed = {}, [], []
        for n, posterior in enumerate(posteriors):
            label, name = None, posterior.observer
            if posterior.state in POOLED_STATES:
                label = names[likeliest[n]] if _holds_label(posterior, p[n], likeliest[n]) else None
                labels.append(label)
                if posterior.reliability >= CONTRADICTED:
                    believed.append(label)
            votes[name] = _vote(
                posterior, p[n], roots[n], entropies[n], weights[n], label, with_facing, resting.get(name),
            )  # fmt: skip
        # Without a vote the pooled posterior is the prior, and its first label would mean nothing.
        fused = names[pooled_likeliest] if labels else ""
        pooled_p = pooled_p if pooled_p[pooled_likeliest] <= 1.0 else _in_range(pooled_p)
        contested = len(labels) > 2 and any(label not in (None, fused) for label in believed)
        agreement = _agreement(labels.count(fused), len(labels))
        return Ballot(votes, pooled_p, entropy, fused, pooled_p[pooled_likeliest], agreement, contested)

    def _entropies(self, rows: Floats) -> list[float]:
        """Same as `entropy_bits` of each row, in half the time."""
        most = self._most_bits
        bits: list[float] = np.dot(rows * np.log(rows + TINY), self._to_bits).tolist()
        return [0.0 if entropy <= 0.0 else most if entropy > most else entropy for entropy in bits]

    def judgement(
        self,
        ballot: Ballot,
        pooled: PooledPosterior,
        facets: PublishedFacets,
        progress: MovementProgress | None,
        why: str | None,
        place: Sequence[float] | None,
        stamp: Stamp,
    ) -> JudgementMessage:
        """The pooled posterior with every observer's vote. why: what a label lacks; used while there is none."""
        if pooled.facing is not None:
            facets = {**facets, FACING: _in_range(pooled.facing.tolist())}
        if progress is not self._progress:
            # Built once, because it changes seldom.
            self._progress = progress
            self._ongoing = None if progress is None else _ongoing(progress, self.verdict_id(progress.began_ns))
        movement, decision = self._ongoing, None if progress is None else progress.decision
        fields = {
            **self._same,
            **stamp,
            "p": ballot.pooled,
            "label": ballot.label,
            "certainty_bits": ballot.entropy,
            "votes": ballot.votes,
            "agreement": ballot.agreement,
            "unlearned": pooled.unlearned,
            "facets": facets or None,
            "facing_deg": None if pooled.facing is None else facing_deg(pooled.facing),
            "movement": movement,
            "why": why if movement is None or movement.label is None else None,
            **repetition_fields(None if decision is None else decision.repetitions),
            "place": None if place is None else list(place),
        }
        return unchecked(JudgementMessage, fields)

    def verdict_id(self, began_ns: int) -> str:
        """The id of the movement that began then, in all messages about it."""
        return f"{self._id_prefix}-{began_ns // MS_NS}"


def _holds_label(posterior: AgedPosterior, p: list[float], likeliest: int) -> bool:
    """Whether the posterior `p` differs from the prior, which is uniform, and "something else" is no likelier."""
    top, unlearned, prior = p[likeliest], posterior.unlearned or 0.0, 1.0 / len(p)
    is_different = top - prior > LABEL_MARGIN or prior - min(p) > LABEL_MARGIN
    return is_different and unlearned <= top * (1.0 - unlearned)


@cache
def _agreement(k: int, n: int) -> Agreement:
    return unchecked(Agreement, {"k": k, "n": n})


def _in_range(p: list[float]) -> list[float]:
    """Pooled probabilities without the round-off that may leave one above 1."""
    return p if max(p) <= 1.0 else [min(probability, 1.0) for probability in p]


def _vote(
    posterior: AgedPosterior,
    p: list[float],
    roots: list[int],
    entropy: float,
    weight: float,
    label: str | None,
    with_facing: bool,
    rest_reliability: float | None,
) -> Vote:
    surprise, repeated = posterior.surprise if with_facing else None, posterior.repeated
    fields = {
        "label": label,
        "entropy": entropy,
        "weight": weight,
        "age_s": posterior.age_s,
        "state": posterior.state,
        "p": p,
        "rest": posterior.rest,
        "skew_s": posterior.skew_s,
        "unlearned": posterior.unlearned,
        "facing": None if surprise is None else unchecked(VotedFacing, {"surprise": surprise.tolist()}),
        "facets": posterior.facets or None,
        "reliability": posterior.reliability,
        "rest_reliability": rest_reliability,
        "label_reliability": posterior.reliability if posterior.reliability < 1.0 else None,
        "doubles": None,
        "root_p": roots,
        "freshness": posterior.freshness if posterior.freshness != 1.0 else None,
        "repetitions": posterior.repetitions,
        "repeated": repeated and unchecked(VotedRepeated, {"partial": repeated.partial, "swing": repeated.swing}),
    }
    if posterior.state not in POOLED_STATES:
        fields |= {"entropy": None, "p": None, "root_p": None, "freshness": None}
    elif not posterior.sees:
        fields["rest"] = None
    return unchecked(Vote, fields)


def _ongoing(movement: MovementProgress, movement_id: str) -> OngoingMovement:
    fields: dict[str, Any] = dict.fromkeys(OngoingMovement.model_fields)
    fields |= {"id": movement_id, "began_ns": movement.began_ns}
    if (decision := movement.decision) is not None:
        fields |= {"label": decision.label, "decided_ns": decision.decided_ns, "revises": decision.revises}
        fields["outage_ns"] = movement.outage_ns
    return unchecked(OngoingMovement, fields)
