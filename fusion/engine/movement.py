"""What the verdict detector takes and returns: the pooled posterior at one time, a movement, the decision on one."""

from dataclasses import dataclass

from common import SECOND_NS
from common.messages import JudgementMessage, VerdictStage


@dataclass(slots=True)
class PooledState:
    """The pooled posterior at one time: the likeliest label, how many observers vote for it, and probabilities.

    p: of the label among all answers; unlearned: of "something else", which is no label; rest: of being at rest.
    observed: whether the posterior of any observer counts. heard_ns: when the newest of them was captured; None: at_ns.
    """

    at_ns: int
    label: str
    p: float
    agreeing: int
    rest: float
    unlearned: float = 0.0
    observed: bool = True
    heard_ns: int | None = None

    @property
    def idle(self) -> bool:
        """Whether no movement of the vocabulary is likelier than one."""
        return self.rest >= 0.5 or self.unlearned > 0.5


@dataclass(frozen=True, slots=True)
class MovementDecision:
    """Label or ABSTAIN, begin of the movement, time of decision; the end when it is known.

    revises: the label that `label` replaced; None while the first one stands.
    """

    label: str
    began_ns: int
    decided_ns: int
    ended_ns: int | None = None
    stage: VerdictStage = "decided"
    revises: str | None = None


@dataclass(frozen=True, slots=True)
class MovementProgress:
    """A movement that has not ended: when it began, and the decision, if there is one."""

    began_ns: int
    decision: MovementDecision | None = None


def last_heard_ns(judgement: JudgementMessage) -> int:
    """When the service that sent a judgement had heard an observer last, as far as the judgement tells; else 0.

    A service that has just started, and hears nobody yet, goes on judging the movement that it continues.
    """
    if judgement.agreement.n:
        return judgement.at_ns
    ages_s = [vote.age_s for vote in judgement.votes.values() if vote.age_s is not None]
    return judgement.at_ns - round(max(min(ages_s), 0.0) * SECOND_NS) if ages_s else 0
