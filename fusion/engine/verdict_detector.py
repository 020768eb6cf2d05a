"""The judge: from the pooled belief over time to one verdict per movement. Pure: time is passed in.

1. A movement begins when the judges hold rest for less likely than movement. What lasts less than `hold_s` is none.
2. It is decided when one label has been at least `threshold` likely, and at least `quorum` judges have held it,
   without a break for `hold_s`, or when the person comes to rest: nothing more will be seen that could be waited for.
3. It ends when rest has been the likelier for `hold_s`, at the time when that rest began; the verdict is then said
   once more, under the same id, with its end and, if the judges held another label by rule 2 when the person came to
   rest, with that: they had seen the whole by then, and later beliefs are memory, where a judge who is stuck wins.
   If "something else" was then at least `threshold` likely it is taken back: an abstention.
   Between the two nothing is said, however often they change their minds.
4. A movement that ends undecided waits, at most another `hold_s`, for a label that meets the demand but has not held
   yet. If none is decided it is an abstention: something was done, and they could not agree.
5. When the clock is set back the judge starts afresh: durations from before it mean nothing.
6. A judge who stands by follows the leading one: the same movement, begun and decided when that one says. What he
   holds himself and for how long is his own, so that he can go on where the other stopped.
"""

from dataclasses import dataclass, replace
from enum import Enum

from common.config_sections import FusionConfig
from common.vocabulary import ABSTAIN

SECOND_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class PooledState:
    """What the judges believe at one time: the likeliest label, how likely, who agrees, and whether at rest.

    p: among all answers; unlearned: that of "something else", which is no label.
    """

    at_ns: int
    label: str
    p: float
    agreeing: int
    rest: float
    unlearned: float = 0.0


@dataclass(frozen=True, slots=True)
class Decision:
    """What was done: began and decided always, ended when known."""

    label: str
    began_ns: int
    decided_ns: int
    ended_ns: int | None = None


class MovementPhase(Enum):
    """Where the judge is between two movements."""

    REST = "rest"
    MOVING = "moving"
    DECIDED = "decided"


class VerdictDetector:
    """Watches the pooled belief and says what was done, once per movement."""

    def __init__(self, config: FusionConfig) -> None:
        self._config = config
        self._hold_ns = config.hold_s * SECOND_NS
        self._last_ns = 0
        self.phase = MovementPhase.REST
        self._decision: Decision | None = None
        self._revision: Decision | None = None

    @property
    def movement(self) -> tuple[int, Decision | None] | None:
        """When the movement that goes on began, and what was decided of it so far; None at rest."""
        return None if self.phase is MovementPhase.REST else (self._began_ns, self._decision)

    def follow(self, movement: tuple[int, Decision | None] | None) -> None:
        """Rule 6: take over the `movement` of another judge."""
        if movement is None:
            self.phase, self._decision, self._revision = MovementPhase.REST, None, None
            return
        began_ns, decision = movement
        if self.phase is MovementPhase.REST:
            self._begin(began_ns)
        if decision is None or self._decision != decision:
            self._revision = None
        self._began_ns, self._decision = began_ns, decision
        self.phase = MovementPhase.MOVING if decision is None else MovementPhase.DECIDED

    @property
    def grounds_at(self) -> frozenset[int]:
        """Of which times the grounds must be kept for what will be said: decisions, and the beginning of rest."""
        rested = () if self.phase is MovementPhase.REST or self._resting_since_ns is None else (self._resting_since_ns,)
        return frozenset((*(d.decided_ns for d in (self._decision, self._revision) if d), *rested))

    def watch(self, belief: PooledState) -> Decision | None:
        """One step; returns a decision when it is made, and once more when the movement has ended."""
        at_ns = belief.at_ns
        if at_ns < self._last_ns:
            self.phase, self._decision, self._revision = MovementPhase.REST, None, None
        self._last_ns = at_ns
        if self.phase is MovementPhase.REST:
            if belief.rest >= 0.5:
                return None
            self._begin(at_ns)
        held = self._held(belief)
        moved = self._resting_since_ns is None
        self._heed_rest(belief, held)
        if held is None and moved and self._resting_since_ns is not None and self._candidate is not None:
            # He has come to rest: nothing more will be seen that could be waited for.
            held = self._candidate[0]
        if self._resting_since_ns is not None and at_ns - self._resting_since_ns >= self._patience_ns(held):
            return self._close(held, at_ns, self._resting_since_ns)
        if self.phase is MovementPhase.MOVING and held is not None and self._is_movement(at_ns):
            self.phase, self._decision = MovementPhase.DECIDED, Decision(held, self._began_ns, at_ns)
            return self._decision
        return None

    def _begin(self, at_ns: int) -> None:
        self.phase, self._began_ns = MovementPhase.MOVING, at_ns
        self._candidate: tuple[str, int] | None = None
        self._resting_since_ns: int | None = None

    def _held(self, belief: PooledState) -> str | None:
        """The label that has met the demand for long enough, if any."""
        if belief.p < self._config.threshold or belief.agreeing < self._config.quorum:
            self._candidate = None
            return None
        if self._candidate is None or self._candidate[0] != belief.label:
            self._candidate = (belief.label, belief.at_ns)
        label, since_ns = self._candidate
        return label if belief.at_ns - since_ns >= self._hold_ns else None

    def _heed_rest(self, belief: PooledState, held: str | None) -> None:
        if belief.rest < 0.5:
            self._resting_since_ns = self._revision = None
        elif self._resting_since_ns is None:
            self._resting_since_ns = belief.at_ns
            last = ABSTAIN if belief.unlearned >= self._config.threshold else held
            if self._decision is not None and last not in (None, self._decision.label):
                self._revision = replace(self._decision, label=last, decided_ns=belief.at_ns)

    def _patience_ns(self, held: str | None) -> float:
        """How long rest must have lasted for the movement to have ended (rules 3 and 4)."""
        undecided = self._decision is None and held is None and self._candidate is not None
        return 2 * self._hold_ns if undecided else self._hold_ns

    def _is_movement(self, at_ns: int) -> bool:
        """Rule 1: a flicker of rest is no movement, even while the label of the one before is still believed."""
        moved_until_ns = at_ns if self._resting_since_ns is None else self._resting_since_ns
        return moved_until_ns - self._began_ns >= self._hold_ns

    def _close(self, held: str | None, at_ns: int, ended_ns: int) -> Decision | None:
        decision, self.phase = self._revision or self._decision, MovementPhase.REST
        self._decision = self._revision = None
        if decision is None and self._is_movement(at_ns):
            decision = Decision(held or ABSTAIN, self._began_ns, at_ns)
        return None if decision is None else replace(decision, ended_ns=ended_ns)
