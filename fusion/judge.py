"""The judge: from the pooled belief over time to one verdict per movement. Pure: time is passed in.

1. A movement begins when the judges hold rest for less likely than movement.
2. It is decided when one label has been at least `threshold` likely, and at least `quorum` judges have held it,
   without a break for `hold_s`.
3. It ends when rest is again the likelier for `hold_s`; the verdict is then said once more, under the same id, with
   its end and, if the judges changed their minds meanwhile and meet rule 2 anew, with the new label.
4. A movement that lasted `hold_s` and ended undecided is an abstention: something was done, and they could not agree.
"""

from dataclasses import dataclass, replace
from enum import Enum
from typing import Protocol

from common.messages import ABSTAIN

SECOND_NS = 1_000_000_000


class Demand(Protocol):
    """What a verdict takes."""

    @property
    def threshold(self) -> float:
        """Least pooled probability of the label, 0 to 1."""

    @property
    def quorum(self) -> int:
        """Least number of judges who hold the label themselves."""

    @property
    def hold_s(self) -> float:
        """For how long both must be met, in seconds."""


@dataclass(frozen=True, slots=True)
class Belief:
    """What the judges believe at one time: the likeliest label, how likely, who agrees, and whether at rest."""

    at_ns: int
    label: str
    p: float
    agreeing: int
    rest: float


@dataclass(frozen=True, slots=True)
class Decision:
    """What was done: began and decided always, ended when known."""

    label: str
    began_ns: int
    decided_ns: int
    ended_ns: int | None = None


class Phase(Enum):
    """Where the judge is between two movements."""

    REST = "rest"
    MOVING = "moving"
    DECIDED = "decided"


class Judge:
    """Watches the pooled belief and says what was done, once per movement."""

    def __init__(self, demand: Demand) -> None:
        self._demand = demand
        self.phase = Phase.REST
        self._began_ns = 0
        self._resting_since_ns: int | None = None
        self._candidate: tuple[str, int] | None = None
        self._decision: Decision | None = None

    def watch(self, belief: Belief) -> Decision | None:
        """One step; returns a decision when it is made, changed by its end, or ended."""
        if self.phase is Phase.REST:
            if belief.rest >= 0.5:
                return None
            self.phase, self._began_ns = Phase.MOVING, belief.at_ns
            self._candidate = self._decision = None
        held = self._held(belief)
        ended_ns = self._ended(belief)
        if self.phase is Phase.MOVING and held is not None:
            self.phase = Phase.DECIDED
            self._decision = Decision(held, self._began_ns, belief.at_ns)
            if ended_ns is None:
                return self._decision
        return None if ended_ns is None else self._close(held, belief.at_ns, ended_ns)

    def _close(self, held: str | None, at_ns: int, ended_ns: int) -> Decision | None:
        decision, self.phase, self._resting_since_ns = self._decision, Phase.REST, None
        if decision is None:
            if ended_ns - self._began_ns < self._demand.hold_s * SECOND_NS:
                return None
            return Decision(ABSTAIN, self._began_ns, at_ns, ended_ns)
        return replace(decision, label=held or decision.label, ended_ns=ended_ns)

    def _held(self, belief: Belief) -> str | None:
        """The label that has met the demand for long enough, if any."""
        if belief.p < self._demand.threshold or belief.agreeing < self._demand.quorum:
            self._candidate = None
            return None
        if self._candidate is None or self._candidate[0] != belief.label:
            self._candidate = (belief.label, belief.at_ns)
        label, since_ns = self._candidate
        return label if belief.at_ns - since_ns >= self._demand.hold_s * SECOND_NS else None

    def _ended(self, belief: Belief) -> int | None:
        """When rest began, once it has been the likelier for long enough."""
        if belief.rest < 0.5:
            self._resting_since_ns = None
            return None
        if self._resting_since_ns is None:
            self._resting_since_ns = belief.at_ns
        since_ns = self._resting_since_ns
        return since_ns if belief.at_ns - since_ns >= self._demand.hold_s * SECOND_NS else None
