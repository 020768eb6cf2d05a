"""Scores what a person has just done: once when its rest begins, and not while anybody moves. No clock."""

from typing import TYPE_CHECKING

from common import SECOND_NS
from common.posterior import ObservedRemark, ObservedScore
from common.score import REMARKS_LIMIT
from observer.model.body_trace import hop_of
from observer.model.movement_segment import STILL_LAG_S
from observer.tracks import Floats

if TYPE_CHECKING:
    from observer.model.base import Header, Watch

LAG_NS = round(STILL_LAG_S * SECOND_NS)
"""Rest and motion for less than this are the delay of stillness: neither begins or ends a performance."""

MOSTLY = 0.5
"""The share of the frames in which a part has to be seen."""

LEAST_SHARE = 0.5
"""Of the shortest reference: what is shorter is a part of a movement, whose begin was not noticed."""


class PerformanceScorer:
    """Scores the likeliest movement once it is over, against the references of a model that has some.

    A score stays until the next movement is over: a repeated movement may end after that has begun.
    """

    def __init__(self, header: "Header") -> None:
        self._references, self._labels = header.references, header.vocabulary.labels
        self._hop, self._lag = hop_of(header.rate_hz), STILL_LAG_S * header.rate_hz
        # The frames of the performance that was scored, and when the person was still last.
        self._frames, self._still_ns = 0, 0
        self._newest: ObservedScore | None = None

    def update(self, watch: "Watch", p: Floats, at_ns: int) -> ObservedScore | None:
        """The score after a frame at `at_ns`; p (M,): the posterior then."""
        frames = watch.performed
        if not frames:
            if abs(at_ns - self._still_ns) > LAG_NS:
                self._frames = 0
            return self._newest
        self._still_ns = at_ns
        if not self._frames or abs(frames - self._frames) > self._lag:
            self._frames, self._newest = frames, self._scored(watch, self._labels[int(p.argmax())], at_ns)
        return self._newest

    def _scored(self, watch: "Watch", label: str, ended_ns: int) -> ObservedScore | None:
        """None for what cannot be scored."""
        references = self._references.get(label)
        performance = None if references is None else watch.performance()
        if references is None or performance is None:
            return None
        rows, seen = performance
        trace = rows[:: self._hop]
        if len(trace) < LEAST_SHARE * min(len(take.trace) for take in references.takes):
            return None
        judged = references.judge(trace, [share >= MOSTLY for share in seen.tolist()])
        if judged.score is None:
            return None
        remarks = [
            ObservedRemark(joint=each.joint, moment=each.moment, degrees=each.degrees, strength=each.strength)
            for each in judged.remarks[:REMARKS_LIMIT]
        ]
        return ObservedScore(
            label=label, ended_ns=ended_ns, score=judged.score, certainty=judged.certainty, remarks=remarks
        )
