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


class PerformanceScorer:
    """Scores the likeliest movement once it is over, against the references of a model that has some.

    A score stays until the person has moved again for LAG_NS.
    """

    def __init__(self, header: "Header") -> None:
        self._references, self._labels = header.references, header.vocabulary.labels
        self._hop, self._lag = hop_of(header.rate_hz), STILL_LAG_S * header.rate_hz
        self._scores: dict[str, ObservedScore | None] = {}
        # The frames of the performance that was scored, when it ended, and when the person was still last.
        self._frames, self._ended_ns, self._still_ns = 0, 0, 0
        self._newest: ObservedScore | None = None

    def update(self, watch: "Watch", p: Floats, unlearned: float | None, at_ns: int) -> ObservedScore | None:
        """The score after a frame at `at_ns`; p (M,), unlearned: the posterior then."""
        frames = watch.performed
        if not frames:
            if abs(at_ns - self._still_ns) > LAG_NS:
                self._frames, self._newest = 0, None
            return self._newest
        self._still_ns = at_ns
        if not self._frames or abs(frames - self._frames) > self._lag:
            self._frames, self._ended_ns = frames, at_ns
            self._scores.clear()
        likeliest = int(p.argmax())
        label, other = self._labels[likeliest], unlearned or 0.0
        if label not in self._references or other > (1.0 - other) * float(p[likeliest]):
            self._newest = None
        else:
            if label not in self._scores:
                self._scores[label] = self._scored(watch, label)
            self._newest = self._scores[label]
        return self._newest

    def _scored(self, watch: "Watch", label: str) -> ObservedScore | None:
        """None for what cannot be scored."""
        performance = watch.performance()
        if performance is None:
            return None
        trace, seen = performance
        judged = self._references[label].judge(trace[:: self._hop], [share >= MOSTLY for share in seen.tolist()])
        if judged.score is None:
            return None
        remarks = [
            ObservedRemark(joint=each.joint, moment=each.moment, degrees=each.degrees, strength=each.strength)
            for each in judged.remarks[:REMARKS_LIMIT]
        ]
        return ObservedScore(
            label=label, ended_ns=self._ended_ns, score=judged.score, certainty=judged.certainty, remarks=remarks
        )
