"""Builds the messages of a fusion service: votes, judgements and verdicts. Pure.

The message classes clamp round-off, so that every probability and entropy in them lies within its range.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from common.messages import (
    Agreement,
    Contribution,
    Facing,
    JudgementMessage,
    OngoingMovement,
    VerdictMessage,
    VerdictStage,
    VocabularyReference,
    Vote,
)
from common.probability import Floats, entropy_bits
from common.vocabulary import Vocabulary
from fusion.engine.pooling import FACING, PooledPosterior, facing_deg
from fusion.engine.roster import POOLED_STATES, AgedPosterior
from fusion.engine.verdict_detector import MovementDecision, MovementProgress

LABEL_MARGIN = 0.01
"""A posterior that differs from the prior by no more than this holds no label."""
FACING_CELLS_LIMIT = 8192
"""Votes carry facings of up to so many cells together; more would not fit into a message."""


@dataclass(frozen=True, slots=True)
class Ballot:
    """The votes, the likeliest label with its probability, and how many votes agree with it; "" without a vote."""

    votes: dict[str, Vote]
    label: str
    p: float
    agreement: Agreement


@dataclass(frozen=True, slots=True)
class Stamp:
    """The service that publishes a message, and the message's number and time."""

    fusion: str
    seq: int
    at_ns: int
    epoch: int | None = None
    session: str | None = None


class JudgementBuilder:
    """Builds the votes and judgements of one scene."""

    def __init__(self, scene: str, vocabulary: Vocabulary, prior: Floats, rule: str) -> None:
        self._scene, self._vocabulary, self._prior, self._rule = scene, vocabulary, prior, rule
        self._reference = VocabularyReference(name=vocabulary.name, hash=vocabulary.digest)

    def ballot(self, posteriors: Sequence[AgedPosterior], pooled: PooledPosterior) -> Ballot:
        """Every observer's vote, and the fused label."""
        rows = np.array([posterior.p for posterior in posteriors])
        columns = (posteriors, entropy_bits(rows).tolist(), pooled.weights.tolist(), self._labels(posteriors, rows))
        cells = sum(posterior.surprise.size for posterior in posteriors if posterior.surprise is not None)
        votes = {
            posterior.observer: _vote(posterior, entropy, weight, label, cells <= FACING_CELLS_LIMIT)
            for posterior, entropy, weight, label in zip(*columns, strict=True)
        }
        labels = [vote.label for vote in votes.values() if vote.state in POOLED_STATES]
        likeliest = int(pooled.p.argmax())
        # Without a vote the pooled posterior is the prior, and its first label would mean nothing.
        fused = self._vocabulary.labels[likeliest] if labels else ""
        return Ballot(votes, fused, float(pooled.p[likeliest]), Agreement(k=labels.count(fused), n=len(labels)))

    def judgement(
        self,
        ballot: Ballot,
        pooled: PooledPosterior,
        facets: Mapping[str, Floats],
        movement: OngoingMovement | None,
        why: str | None,
        stamp: Stamp,
    ) -> JudgementMessage:
        """The pooled posterior with every observer's vote. why: what a label lacks; used while there is none."""
        pooled_facets = {name: p.tolist() for name, p in facets.items()}
        if pooled.facing is not None:
            pooled_facets[FACING] = pooled.facing.tolist()
        return JudgementMessage(
            scene=self._scene,
            fusion=stamp.fusion,
            seq=stamp.seq,
            at_ns=stamp.at_ns,
            vocabulary=self._reference,
            p=pooled.p.tolist(),
            label=ballot.label,
            certainty_bits=float(entropy_bits(pooled.p)),
            rule=self._rule,
            votes=ballot.votes,
            agreement=ballot.agreement,
            unlearned=pooled.unlearned,
            facets=pooled_facets or None,
            facing_deg=None if pooled.facing is None else facing_deg(pooled.facing),
            movement=movement,
            why=why if movement is None or movement.label is None else None,
            epoch=stamp.epoch,
            session=stamp.session,
        )

    def _labels(self, posteriors: Sequence[AgedPosterior], rows: Floats) -> list[str | None]:
        """The label that each observer holds; rows (N, M) are their posteriors."""
        # The first label is the likeliest of a uniform posterior, and agrees with nobody.
        is_informed = np.abs(rows - self._prior).max(axis=1) > LABEL_MARGIN
        unlearned = np.array([posterior.unlearned or 0.0 for posterior in posteriors])
        has_label = is_informed & (unlearned <= rows.max(axis=1) * (1 - unlearned))
        likeliest = zip(rows.argmax(axis=1).tolist(), has_label.tolist(), strict=True)
        return [self._vocabulary.labels[m] if known else None for m, known in likeliest]


def _vote(posterior: AgedPosterior, entropy: float, weight: float, label: str | None, with_facing: bool) -> Vote:
    is_used, surprise = posterior.state in POOLED_STATES, posterior.surprise if with_facing else None
    return Vote(
        label=label if is_used else None,
        entropy=entropy if is_used else None,
        weight=weight,
        age_s=posterior.age_s,
        state=posterior.state,
        p=posterior.p.tolist() if is_used else None,
        rest=posterior.rest,
        skew_s=posterior.skew_s,
        unlearned=posterior.unlearned,
        # The values come from checked messages.
        facing=None if surprise is None else Facing.model_construct(surprise=surprise.tolist()),
        facets={name: p.tolist() for name, p in posterior.facets.items()} or None,
        reliability=posterior.reliability,
        doubles=dict(posterior.correlations) or None,
    )


def build_verdict(
    evidence: JudgementMessage,
    end: JudgementMessage,
    decision: MovementDecision,
    why: str | None,
    contributions: Mapping[str, Contribution] | None,
    verdict_id: str,
    stamp: Stamp,
) -> VerdictMessage:
    """The verdict for `decision`: posterior and votes are those of `evidence`, facets and facing those of `end`."""
    fields = {name: getattr(evidence, name) for name in JudgementMessage.model_fields}
    fields |= {"facets": end.facets, "facing_deg": end.facing_deg, "movement": None, "label": decision.label}
    fields |= {"fusion": stamp.fusion, "seq": stamp.seq, "at_ns": stamp.at_ns}
    fields |= {"epoch": stamp.epoch, "session": stamp.session, "id": verdict_id, "contributions": contributions}
    fields |= {"began_ns": decision.began_ns, "decided_ns": decision.decided_ns, "ended_ns": decision.ended_ns}
    fields |= {"stage": decision.stage, "revises": decision.revises, "why": why}
    return VerdictMessage.model_validate(fields)


def close_verdict(verdict: VerdictMessage, ended_ns: int, same_as: str | None, stamp: Stamp) -> VerdictMessage:
    """`verdict` once more, as the end of its movement."""
    fields = {"fusion": stamp.fusion, "seq": stamp.seq, "at_ns": stamp.at_ns}
    fields |= {"epoch": stamp.epoch, "session": stamp.session, "same_as": same_as}
    return verdict.model_copy(update={**fields, "stage": "ended", "ended_ns": max(ended_ns, verdict.decided_ns)})


def build_ongoing(movement: MovementProgress, movement_id: str) -> OngoingMovement:
    """The movement in progress as judgements carry it."""
    decision = movement.decision
    return OngoingMovement(
        id=movement_id,
        began_ns=movement.began_ns,
        label=None if decision is None else decision.label,
        decided_ns=None if decision is None else decision.decided_ns,
        revises=None if decision is None else decision.revises,
    )


def progress_of(message: OngoingMovement | VerdictMessage) -> MovementProgress:
    """The inverse of `build_ongoing`."""
    if message.label is None or message.decided_ns is None:
        return MovementProgress(message.began_ns)
    stage: VerdictStage = "decided" if message.revises is None else "revised"
    decision = MovementDecision(
        message.label, message.began_ns, message.decided_ns, stage=stage, revises=message.revises
    )
    return MovementProgress(message.began_ns, decision)
