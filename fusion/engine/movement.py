"""The data of the verdict detector: the pooled posterior at one time, a movement, a candidate, a decision."""

from dataclasses import dataclass

from common import SECOND_NS
from common.messages import JudgementMessage, VerdictStage


@dataclass(slots=True)
class PooledState:
    """The pooled posterior at one time: the likeliest label, how many observers vote for it, and probabilities.

    p: of the label among all answers; unlearned: of "something else", which is no label; rest: of being at rest.
    agreeing: observers whose own label it is. observed: whether the posterior of any observer is pooled.
    newest_capture_ns: capture time of the newest of them; None: at_ns.
    """

    at_ns: int
    label: str
    p: float
    agreeing: int
    rest: float
    unlearned: float = 0.0
    observed: bool = True
    newest_capture_ns: int | None = None

    @property
    def idle(self) -> bool:
        """Whether rest or "something else" is likelier than a movement of the vocabulary."""
        return self.rest >= 0.5 or self.unlearned > 0.5


@dataclass(frozen=True, slots=True)
class LabelCandidate:
    """A label that has met threshold and quorum without a break since `since_ns`."""

    label: str
    since_ns: int


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


def last_capture_ns(judgement: JudgementMessage) -> int:
    """The capture time of the newest posterior of the service that sent a judgement, by its votes; 0 without one.

    A service that has just started, and has no posterior yet, goes on judging the movement that it continues.
    """
    if judgement.agreement.n:
        return judgement.at_ns
    ages_s = [vote.age_s for vote in judgement.votes.values() if vote.age_s is not None]
    return judgement.at_ns - round(max(min(ages_s), 0.0) * SECOND_NS) if ages_s else 0
