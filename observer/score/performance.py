"""Scores what a person has just done: once when its rest begins, and not while anybody moves. No clock."""

from typing import TYPE_CHECKING

from common import SECOND_NS
from common.posterior import ObservedRemark, ObservedScore, Unscored
from common.score import REMARKS_LIMIT
from observer.features import hop_of
from observer.model.movement_segment import STILL_LAG_S
from observer.score.references import JudgeScore
from observer.tracks import Floats

if TYPE_CHECKING:
    from observer.model.base import Header, Watch

LAG_NS = round(STILL_LAG_S * SECOND_NS)
"""Rest and motion for less than this are the delay of stillness: neither begins or ends a performance."""

MOSTLY = 0.5
"""The share of the frames in which a part has to be seen."""

LEAST_REFERENCE_SHARE = 0.5
"""Of the shortest reference: what is shorter is a part of a movement, whose begin was not noticed."""
BEGIN_UNSEEN = "its begin was not seen"


class PerformanceScorer:
    """Scores the likeliest movement once it is over, against the references of a model that has some.

    A score, or the reason why there is none, stays until the next movement is over: a repeated movement may end after
    that has begun.
    """

    def __init__(self, header: "Header") -> None:
        self._references, self._labels = header.references, header.vocabulary.labels
        self._hop, self._lag = hop_of(header.rate_hz), STILL_LAG_S * header.rate_hz
        # The frames of the performance that was scored, and when the person was still after one last.
        self._frames, self._still_ns = 0, 0
        # When the person began to move; None while they rest.
        self._moving_ns: int | None = None
        self._newest: ObservedScore | Unscored | None = None

    def update(self, watch: "Watch", p: Floats, at_ns: int) -> ObservedScore | Unscored | None:
        """The last score, or why there is none, after a frame at `at_ns`; None before the first. p (M,): posterior."""
        frames, label = watch.performed, self._labels[int(p.argmax())]
        moving_ns, self._moving_ns = self._moving_ns, None if watch.rest >= 0.5 else self._moving_ns or at_ns
        if frames:
            self._still_ns = at_ns
            if not self._frames or abs(frames - self._frames) > self._lag:
                self._frames, self._newest = frames, self._scored(watch, label, at_ns)
            return self._newest
        if abs(at_ns - self._still_ns) > LAG_NS:
            self._frames = 0
            if moving_ns is not None and self._moving_ns is None and abs(at_ns - moving_ns) > LAG_NS:
                self._newest = Unscored(label=label, ended_ns=at_ns, reason=BEGIN_UNSEEN)
        return self._newest

    def _scored(self, watch: "Watch", label: str, ended_ns: int) -> ObservedScore | Unscored:
        judged = self._judged(watch, label)
        if judged.score is None:
            return Unscored(label=label, ended_ns=ended_ns, reason=judged.uncertain)
        remarks = [
            ObservedRemark(joint=each.joint, moment=each.moment, degrees=each.degrees, strength=each.strength)
            for each in judged.remarks[:REMARKS_LIMIT]
        ]
        return ObservedScore(
            label=label, ended_ns=ended_ns, score=judged.score, certainty=judged.certainty, remarks=remarks
        )

    def _judged(self, watch: "Watch", label: str) -> JudgeScore:
        references = self._references.get(label)
        if references is None:
            return JudgeScore(None, uncertain="it has no reference takes")
        performance = watch.performance()
        if performance is None:
            return JudgeScore(None, uncertain=BEGIN_UNSEEN)
        rows, seen = performance
        trace = rows[:: self._hop]
        if len(trace) < LEAST_REFERENCE_SHARE * min(len(take.trace) for take in references.takes):
            return JudgeScore(None, uncertain=BEGIN_UNSEEN)
        return references.judge(trace, [share >= MOSTLY for share in seen.tolist()])
