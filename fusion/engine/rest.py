"""The pooled probability that the person rests; one observer may be wrong, stuck or hostile. Pure: time is passed in.

The design: fusion.md, "Who may say that the person rests".

1. The pooled rest is the median over the observers whose posterior is pooled, each weighted by its freshness and by the
   trust in its rest probability (rest_trust.py). The rule's weights play no part: an observer that cannot tell two
   movements apart still sees that the person moves.
2. If two contradict each other and nothing shows which of them is wrong, the pooled rest stays as it was until they
   agree, so that no movement is cut into pieces.
3. If no posterior is pooled, the last rest probabilities of observers that disappeared lately are used, because the
   network may have failed. If none is left, the pooled rest is 1.
"""

from collections.abc import Mapping, Sequence

from fusion.engine.rest_trust import RestTrust
from fusion.engine.roster import POOLED_STATES, AgedPosterior

LEAST_FRESHNESS = 1e-9
"""An observer whose posterior is less fresh is left out."""
LEAST_SHARE = 0.1
"""An observer with a smaller weight than this share of the largest is left out."""
CLEAR = 0.25
"""Two that contradict each other have agreed again when the pooled rest is no further from 0 or 1."""


class RestPool:
    """The pooled rest over time; `update` takes one step."""

    def __init__(self) -> None:
        self.trust: Sequence[float] = ()
        """The trust in each observer's rest probability, in the order of the posteriors of the last step."""
        self._trust = RestTrust()
        self._last = 1.0

    @property
    def reliability(self) -> Mapping[str, float]:
        """The reliability about rest, 0 to 1, of each observer that lately lost trust."""
        return self._trust.reliability

    @property
    def contested(self) -> bool:
        """Whether two observers contradict each other, and nothing shows which of them is wrong."""
        return self._trust.contested

    def update(self, posteriors: Sequence[AgedPosterior], now_ns: int) -> float:
        """The probability that the person is at rest."""
        self.trust = self._trust.update(posteriors, now_ns)
        rest = pooled_rest(posteriors, self.trust)
        if not self.contested or abs(rest - 0.5) >= 0.5 - CLEAR:
            self._last = rest
        return self._last


def pooled_rest(posteriors: Sequence[AgedPosterior], trust: Sequence[float] | None = None) -> float:
    """The probability that the person is at rest: the weighted median (1, 3), which is the mean of two.

    trust: of each posterior, above 0 to 1; None: 1 each.
    """
    weights = [1.0] * len(posteriors) if trust is None else trust
    fresh = [posterior.rest for posterior in posteriors if posterior.freshness == 1.0 and posterior.state == "counted"]
    if fresh and len(fresh) == len(posteriors) and weights.count(1.0) == len(fresh):
        # The usual case: all are fresh and trusted.
        fresh.sort()
        low, high = fresh[(len(fresh) - 1) // 2], fresh[len(fresh) // 2]
        return low + (high - low) / 2
    weighted = sorted(
        (posterior.rest, posterior.freshness * weight)
        for posterior, weight in zip(posteriors, weights, strict=True)
        if posterior.state in POOLED_STATES and posterior.freshness > LEAST_FRESHNESS
    )
    # A negligible weight would still draw the interpolation to its side.
    largest = max((weight for _, weight in weighted), default=0.0)
    # With room for round-off, so that the scale of the weights does not matter.
    weighted = [(rest, weight) for rest, weight in weighted if weight >= LEAST_SHARE * largest * (1 - 1e-9)]
    if not weighted:
        weighted = sorted((posterior.rest, 1.0) for posterior in posteriors if posterior.rest < 1.0) or [(1.0, 1.0)]
    return _weighted_median(weighted)


def _weighted_median(weighted: Sequence[tuple[float, float]]) -> float:
    """The median of (rest, weight) pairs in rising order of rest, at least one, interpolated between two.

    Each value stands at the middle of its weight. Plain Python, because there are few observers.
    """
    half, before = sum(weight for _, weight in weighted) / 2, 0.0
    last_rest, last_middle = weighted[0][0], 0.0
    for rest, weight in weighted:
        middle = before + weight / 2
        if middle >= half:
            # Round-off may exceed 1.
            return min(last_rest + (rest - last_rest) * (half - last_middle) / (middle - last_middle), rest)
        last_rest, last_middle, before = rest, middle, before + weight
    return last_rest
