"""Earlier steps that the engine keeps, because later verdicts are based on them.

Nothing changes these; they are not frozen, as AgedPosterior is not.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from common.messages import JudgementMessage
from fusion.engine.movement import PooledState
from fusion.engine.roster import AgedPosterior


@dataclass(slots=True)
class VerdictBasis:
    """A judgement that a verdict may be based on, its posteriors, and what a label lacked then.

    Without posteriors if it is a verdict, or came from another service.
    """

    judgement: JudgementMessage
    posteriors: Sequence[AgedPosterior] = ()
    why: str | None = None


NO_BASES: Mapping[int, VerdictBasis] = {}
"""By the time of the step, Unix epoch in ns."""


@dataclass(slots=True)
class NearestMiss:
    """The step at which the movement begun at `began_ns` came nearest to a verdict: its label's `p`, what it lacked."""

    began_ns: int = 0
    p: float = -1.0
    why: str | None = None


@dataclass(slots=True)
class LastObserved:
    """The last step, if an observer counted in it."""

    state: PooledState
    basis: VerdictBasis
