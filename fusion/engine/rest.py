"""Whether the person rests, decided by observers of which one may be wrong, stuck or hostile. Pure: time is passed in.

1. The pooled rest is the median over the observers whose posterior is pooled, each weighted by its freshness and by the
   trust in its word on rest (rest_trust.py). The rule's weights play no part: an observer that cannot tell two
   movements apart still sees that the person moves.
2. If two contradict each other and nothing tells which of them is wrong, the pooled rest stays as it was until they
   agree, so that no movement is cut into pieces.
3. If no observer is pooled, the rest of those that went lately holds a little longer, because the network may have
   failed; long silence of all is rest.
"""

from collections.abc import Mapping, Sequence

from fusion.engine.rest_trust import RestTrust
from fusion.engine.roster import POOLED_STATES, AgedPosterior

LEAST_FRESHNESS = 1e-9
"""An observer with less left of its opinion has no vote on rest."""
LEAST_SHARE = 0.1
"""A vote with less of the largest weight is left out."""
CLEAR = 0.25
"""Two that contradict each other have agreed again when the pooled rest is no further from 0 or 1."""


class RestPool:
    """The pooled rest over time; `update` takes one step."""

    def __init__(self) -> None:
        self.trust: Sequence[float] = ()
        """The trust in each observer's word, in the order of the posteriors of the last step."""
        self._trust = RestTrust()
        self._last = 1.0

    @property
    def reliability(self) -> Mapping[str, float]:
        """How far an observer's word on rest can be relied on, 0 to 1, of those that lately lost trust."""
        return self._trust.reliability

    @property
    def contested(self) -> bool:
        """Whether two contradict each other, and nothing tells which of them is wrong."""
        return self._trust.contested

    def update(self, posteriors: Sequence[AgedPosterior], now_ns: int) -> float:
        """The probability that the person is at rest."""
        self.trust = self._trust.update(posteriors, now_ns)
        rest = pooled_rest(posteriors, self.trust)
        if not self.contested or abs(rest - 0.5) >= 0.5 - CLEAR:
            self._last = rest
        return self._last


def pooled_rest(posteriors: Sequence[AgedPosterior], trust: Sequence[float] | None = None) -> float:
    """The probability that the person is at rest: the weighted median (1), the mean of two. trust: 1 each if None."""
    weights = [1.0] * len(posteriors) if trust is None else trust
    sure = [one.rest for one in posteriors if one.freshness == 1.0 and one.state == "counted"]
    if sure and len(sure) == len(posteriors) and weights.count(1.0) == len(sure):
        # The usual case: all are fresh and trusted.
        sure.sort()
        low, high = sure[(len(sure) - 1) // 2], sure[len(sure) // 2]
        return low + (high - low) / 2
    votes = sorted(
        (one.rest, one.freshness * weight)
        for one, weight in zip(posteriors, weights, strict=True)
        if one.state in POOLED_STATES and one.freshness > LEAST_FRESHNESS
    )
    # One that hardly counts would still draw the interpolation to its side.
    most = max((weight for _, weight in votes), default=0.0)
    # With room for round-off, so that the scale of the weights does not matter.
    votes = [vote for vote in votes if vote[1] >= LEAST_SHARE * most * (1 - 1e-9)]
    if not votes:
        votes = sorted((one.rest, 1.0) for one in posteriors if one.rest < 1.0) or [(1.0, 1.0)]
    # Each vote stands at the middle of its weight; between two votes the result is interpolated. Plain Python, because
    # there are few observers.
    half, before = sum(weight for _, weight in votes) / 2, 0.0
    last_rest, last_middle = votes[0][0], 0.0
    for rest, weight in votes:
        middle = before + weight / 2
        if middle >= half:
            # Round-off may exceed 1.
            return min(last_rest + (rest - last_rest) * (half - last_middle) / (middle - last_middle), rest)
        last_rest, last_middle, before = rest, middle, before + weight
    return last_rest
