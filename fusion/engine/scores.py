"""The score of a verdict: what the observers say that scored its movement, pooled when it has ended. Pure."""

from collections.abc import Iterable

from common.messages import VerdictMessage
from common.score import REMARK_LIMIT
from fusion.engine.aged_posterior import AgedPosterior
from fusion.score_pool import JudgedScore, pooled_remarks, pooled_score

DIGITS = 2
"""Of a score; a mean of scores of 10 stays 10."""


def with_score(verdict: VerdictMessage, posteriors: Iterable[AgedPosterior]) -> VerdictMessage:
    """The verdict with the pooled score of its movement, if it has ended and an observer has scored it as its label.

    A score of what ended before this movement began is of an earlier one, and not used (docs/design/score.md).
    """
    if verdict.ended_ns is None:
        return verdict
    judged = {
        each.observer: each.score
        for each in posteriors
        if each.score is not None and each.score.label == verdict.label and each.score.ended_ns > verdict.began_ns
    }
    if not judged:
        return verdict
    score = pooled_score({name: JudgedScore(own.score, own.certainty) for name, own in judged.items()})
    remarks = pooled_remarks([own.remarks for own in judged.values()])
    return verdict.model_copy(
        update={
            "score": None if score is None else round(score, DIGITS),
            "scores": {name: round(own.score, DIGITS) for name, own in judged.items()},
            "remarks": [remark.words[:REMARK_LIMIT] for remark in remarks] or None,
        }
    )
