"""What a fusion rule is: how it weighs observers, and how it mixes their posteriors. Pure. N observers, M movements."""

from collections.abc import Callable
from dataclasses import dataclass

from common.probability import Floats

Trust = Floats | None
"""(N,) above 0 to 1, how far each observer is relied on (trust.py); None: all are, fully."""


@dataclass(slots=True)
class RuleResult:
    """The pooled p (M,), or (R, K) of a joint posterior; weights (N,), summing to 1, equal if a rule has none.

    Nothing changes one; it is not frozen, because that takes four times as long to make, and each step makes some.
    """

    p: Floats
    weights: Floats


@dataclass(frozen=True, slots=True)
class PoolingWeights:
    """How each of N observers counts.

    exponents: w (N,), of its likelihood ratio p~/prior; (H, N) in a rule that averages over H hypotheses, whose
    probabilities are `hypotheses` (H,). epsilon (N,): share of the prior in p~ = (1 - epsilon) p + epsilon prior.
    shares (N,): its part in the result, summing to 1.
    """

    exponents: Floats
    epsilon: Floats
    shares: Floats
    hypotheses: Floats | None = None


Weigh = Callable[[Floats, Floats, Trust], PoolingWeights]
"""p (N, M), prior (M,), trust -> the weights of N observers."""
Mix = Callable[[Floats, Floats, PoolingWeights], Floats]
"""cells (N, M, K), summing to 1 per observer, prior (M,), weights -> (M, K)."""
PoolMovements = Callable[[Floats, Floats, Trust], RuleResult]
"""p (..., N, M), prior (M,), trust (..., N) -> the pooled p (..., M) and weights (..., N): both steps at once."""


@dataclass(frozen=True, slots=True)
class Rule:
    """A named way to pool p (N, M) with prior (M,).

    pool_movements: both steps for movements alone, if there is a quicker way; it takes leading axes, and pools many
    scenes to the same bits as each alone.
    """

    name: str
    weigh: Weigh
    mix: Mix
    pool_movements: PoolMovements | None = None

    def pool(self, p: Floats, prior: Floats, trust: Trust = None) -> RuleResult:
        """The pooled posterior and the weights; p has leading axes only if there is `pool_movements`."""
        if self.pool_movements is not None:
            return self.pool_movements(p, prior, trust)
        weighed = self.weigh(p, prior, trust)
        return RuleResult(self.mix(p[:, :, None], prior, weighed)[:, 0], weighed.shares)
