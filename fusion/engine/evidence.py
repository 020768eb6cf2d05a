"""What the engine keeps of earlier steps, for the verdicts that rest on them.

Nothing changes these; not frozen, as AgedPosterior.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from common.messages import JudgementMessage
from fusion.engine.movement import PooledState
from fusion.engine.roster import AgedPosterior


@dataclass(slots=True)
class VerdictEvidence:
    """A judgement that a verdict may rest on, its posteriors, and what a label lacked then.

    Without posteriors if it is a verdict, or came from another service.
    """

    judgement: JudgementMessage
    posteriors: Sequence[AgedPosterior] = ()
    why: str | None = None


NO_EVIDENCE: Mapping[int, VerdictEvidence] = {}


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
    evidence: VerdictEvidence
