"""What the segmenter has observed, what was decided, and the conditions of the events in its table. Pure.

The rules are those of segmenter.py. Times: Unix epoch in ns.
"""

from collections.abc import Callable, Mapping

from common import SECOND_NS
from common.config_sections import FusionConfig
from common.message_types import PAUSE_S
from common.vocabulary import Vocabulary
from fusion.engine.rest import CLEAR_MARGIN
from fusion.engine.segment_table import Event, SegmentState
from fusion.engine.segments import (
    ANY,
    NOTICED_S,
    UNKNOWN,
    Durations,
    Heard,
    HeldLabel,
    MovementDecision,
    MovementProgress,
    Pause,
    PooledState,
    Quiet,
    SegmentStep,
    durations_of,
)
from fusion.engine.trust import MOVEMENT_S

CARRIED_S = 2 * NOTICED_S
"""In a simulation of observers that die, freeze and start, none held the previous label for longer than 0.5 s."""
REVISIONS_LIMIT = 3
"""Of one movement, so that labels in turn give no endless series of verdicts; wire.md promises it."""
FADING = 2
"""In multiples of `hold_s`: so long a label has to be unlikely before its movement has ended."""
REVISED_S = 1.0
"""A premature decision is over by then."""
OUTAGE_S, HIDING_S, ENDING_S = 1.0, MOVEMENT_S, 5.0
"""A shorter outage than the first hides no whole movement, nor the whole rest between two; one longer than the second
can hide both; after one longer than the third the same label is another movement (rule 9)."""
CLEAR_REST = 1.0 - CLEAR_MARGIN
"""Pooled rest, the median of the observers, that is no tie of two that contradict each other (rule 4)."""
ENDING = (SegmentState.ENDING, SegmentState.SETTLED)
RESTING = (SegmentState.PAUSED, SegmentState.LOST, *ENDING)


class Conditions:
    """What is known of the movement in progress, and whether an event shows in a step."""

    def __init__(self, config: FusionConfig, vocabulary: Vocabulary) -> None:
        self._threshold, self._quorum, self._hold_ns = config.threshold, config.quorum, config.hold_s * SECOND_NS
        self._durations: Mapping[str, Durations] = durations_of(config, vocabulary)
        self.state = SegmentState.IDLE
        self.movement: MovementProgress | None = None
        """The movement that goes on; None at rest."""
        self._held: HeldLabel | None = None
        """The label that is, or was last, likely enough."""
        self._quiet: Quiet | None = None
        """Since when the movement in progress is not seen."""
        self._contested: str | None = None
        """The last label that would have been decided if no observer had voted for another one."""
        self._heard: Heard | None = None
        self._last_ns = 0

    @property
    def decision(self) -> MovementDecision | None:
        """On the movement in progress."""
        return None if self.movement is None else self.movement.decision

    @property
    def pause(self) -> Pause | None:
        """How long the decided movement may pause because it is periodic; None: it is not."""
        return None if self.decision is None else self._lasting(self.decision.label).pause

    def _lasting(self, label: str) -> Durations:
        """How long movements with a label last."""
        return self._durations.get(label, UNKNOWN)

    @property
    def _resting(self) -> Quiet | None:
        """Since when the person rests; None while they move."""
        return self._quiet if self.state in RESTING else None

    def observe(self, state: PooledState) -> SegmentStep:
        """Take what is pooled at one step."""
        heard_ns, gap_ns = self._hear(state)
        before = self._held if self._held_for(self._last_ns) else None
        self._last_ns = state.at_ns
        self._hold(state, self.state in ENDING and state.rest >= 0.5)
        if self.state is not SegmentState.IDLE and (state.rest < 0.5 or self.state in RESTING):
            self._note_unseen(state)
        met, named = self._held_for(state.at_ns), self._held_for(state.at_ns - state.longer_s * SECOND_NS)
        self._contested = self._contested if met == named else met
        return SegmentStep(state, named, before, heard_ns, gap_ns)

    def _hear(self, state: PooledState) -> tuple[int, int]:
        """Take the newest capture of a step; returns the one before, and the time between both (rule 9)."""
        if not state.observed:
            return 0, 0
        captured_ns = state.at_ns if state.newest_capture_ns is None else state.newest_capture_ns
        last_ns, since_ns = (captured_ns, None) if self._heard is None else self._heard
        if captured_ns - last_ns > OUTAGE_S * SECOND_NS:
            since_ns, self._held, self._contested = state.at_ns, None, None
        self._heard = Heard(max(captured_ns, last_ns), since_ns)
        return last_ns, captured_ns - last_ns

    def _hold(self, state: PooledState, still: bool) -> None:
        """Take the likeliest label. still: a decided movement rests: posteriors only fade, and the label held stays."""
        held, at_ns = self._held, state.at_ns
        is_same = held is not None and held.label == state.label and at_ns - held.last_ns <= NOTICED_S * SECOND_NS
        if state.p < self._threshold:
            if held is not None and held.agreed_ns is not None and not still:
                self._held = held._replace(agreed_ns=None)
        elif held is not None and still:
            self._held = held._replace(last_ns=at_ns) if is_same else held
        else:
            since_ns, agreed_ns = (held.since_ns, held.agreed_ns) if held is not None and is_same else (at_ns, None)
            if state.agreeing < self._quorum:
                agreed_ns = None
            elif agreed_ns is None:
                agreed_ns = at_ns
            self._held = HeldLabel(state.label, since_ns, at_ns, agreed_ns)

    def _note_unseen(self, state: PooledState) -> None:
        """Note since when the movement is not seen, and since when that is beyond doubt."""
        is_resting, at_ns, quiet = state.rest >= 0.5, state.at_ns, self._quiet
        if not is_resting and (self._goes_on(state) or not state.observed):
            self._quiet = None
            return
        has_rested = self.state in RESTING and self.pause is None
        if quiet is None or (has_rested and not is_resting):
            quiet = Quiet(at_ns, None)
        is_clear = state.rest >= CLEAR_REST if is_resting else state.unlearned >= self._threshold
        if is_clear is (quiet.clear_ns is None):
            quiet = Quiet(quiet.since_ns, at_ns if is_clear else None)
        self._quiet = quiet

    def _held_for(self, at_ns: float) -> str | None:
        """The label that meets the demand, and does so for `hold_s` at `at_ns` (rule 2)."""
        held = self._held
        is_met = held is not None and held.agreed_ns is not None and at_ns - held.agreed_ns >= self._hold_ns
        return held.label if held is not None and is_met else None

    def _goes_on(self, state: PooledState) -> bool:
        """Whether the movement goes on: its label is likeliest and half as likely as demanded; undecided, any is."""
        decision = self.decision
        is_own = decision is None or (state.label == decision.label and 2 * state.p >= self._threshold)
        return is_own and not state.idle

    def nameable(self, step: SegmentStep) -> str | None:
        """The label that may be decided now (rules 1 to 3)."""
        movement, at_ns, held, quiet, label = self.movement, step.state.at_ns, self._held, self._resting, step.named
        if label is None and quiet is not None and quiet.since_ns == at_ns and movement is not None:
            label = held.label if held is not None and held.agreed_ns else self._contested
        if movement is None or label is None or self.is_short(at_ns, label) or step.gap_ns > HIDING_S * SECOND_NS:
            return None
        is_carried = movement.carried in (ANY, label) and at_ns - movement.began_ns < CARRIED_S * SECOND_NS
        return None if is_carried and (quiet is None or not step.state.observed) else label

    def is_short(self, at_ns: int, label: str | None) -> bool:
        """Whether the person has moved for too short a time for a movement with this label, or without one (rule 1)."""
        movement, moved_until_ns = self.movement, at_ns if self._resting is None else self._resting.since_ns
        if movement is None or moved_until_ns - movement.began_ns < self._hold_ns:
            return True
        if movement.carried is None or label not in (None, movement.carried):
            return False
        return moved_until_ns - movement.began_ns < self._lasting(movement.carried).least_ns

    def renamed(self) -> str | None:
        """The label that replaces the decided one at rest (rule 6)."""
        decision, quiet, movement = self.decision, self._quiet, self.movement
        if decision is None or movement is None or quiet is None or movement.outage_ns is not None:
            return None
        label = self._held_for(quiet.since_ns)
        return label if label != decision.label and decision.revisions < REVISIONS_LIMIT else None

    def is_revoked(self, step: SegmentStep) -> bool:
        """Whether rest begins after something else that says that the decided label was wrong (rule 6)."""
        quiet, at_ns = self._quiet, step.state.at_ns
        if self.decision is None or self.pause is not None or quiet is None or quiet.clear_ns is None:
            return False
        has_faded = at_ns - quiet.since_ns >= FADING * self._hold_ns
        return at_ns - quiet.clear_ns >= NOTICED_S * SECOND_NS and not has_faded

    def is_seen(self, step: SegmentStep) -> bool:
        """Whether the decided label is the likeliest one, after the step of the decision."""
        decision, state = self.decision, step.state
        if decision is None or state.at_ns <= decision.decided_ns:
            return False
        return state.observed and state.label == decision.label

    def is_back(self, step: SegmentStep) -> bool:
        """Whether the decided label is likely enough to go on."""
        return step.state.observed and self._goes_on(step.state)

    def is_confirmed(self, step: SegmentStep) -> bool:
        """Whether the decided label is held again after an outage."""
        is_out = self.movement is not None and self.movement.outage_ns is not None
        return is_out and self.decision is not None and step.named == self.decision.label

    def is_other(self, step: SegmentStep) -> bool:
        """Whether another label than the decided one is held while the person moves."""
        return step.named is not None and self._is_challenged(step.state)

    def _is_challenged(self, state: PooledState) -> bool:
        """Whether another label than the decided one meets the demand, if not yet for long enough (rule 2)."""
        held, decision = self._held, self.decision
        if held is None or held.agreed_ns is None or decision is None:
            return False
        return state.moves and held.label != decision.label

    def is_next(self, step: SegmentStep) -> bool:
        """Whether another label is held that is that of the next movement (rule 7)."""
        movement, decision = self.movement, self.decision
        if not self.is_other(step) or movement is None or decision is None:
            return False
        soonest_ns = max(NOTICED_S * SECOND_NS, self._lasting(decision.label).least_ns)
        return movement.outage_ns is not None or self._moved_until_held(movement) >= soonest_ns

    def is_premature(self, step: SegmentStep) -> bool:
        """Whether another label is held before the decided one can be over, or long after the decision (rule 7)."""
        movement, decision = self.movement, self.decision
        if not self.is_other(step) or movement is None or decision is None or decision.revisions >= REVISIONS_LIMIT:
            return False
        is_soon = self._moved_until_held(movement) < self._lasting(decision.label).least_ns
        return is_soon or step.state.at_ns - decision.decided_ns >= REVISED_S * SECOND_NS

    def _moved_until_held(self, movement: MovementProgress) -> float:
        """From the begin of the movement until the label that is held now met the demand; ns."""
        held = self._held
        return 0.0 if held is None or held.agreed_ns is None else held.agreed_ns - movement.began_ns

    def is_missed(self, step: SegmentStep) -> bool:
        """Whether the person moves, but the movement has not been seen for long enough (rules 5, 7 and 8)."""
        if self._quiet is None:
            return False
        decision, pause = self.decision, self.pause
        is_open = decision is not None and decision.revisions < REVISIONS_LIMIT
        if is_open and self.state is not SegmentState.PASSED and self._is_challenged(step.state):
            return False
        needed_ns = FADING * self._hold_ns
        if pause is not None:
            needed_ns = pause.else_ns
        elif decision is not None and step.state.idle:
            needed_ns = max(needed_ns, PAUSE_S * SECOND_NS)
        return self._is_quiet(step, needed_ns)

    def is_moving_on(self, step: SegmentStep) -> bool:
        """Whether a movement is likelier again after something else, and not that of the decided label (rule 7)."""
        # Later than when it would be missed: a movement that is missed in this step begins with the next one.
        is_late = self._is_quiet(step, FADING * self._hold_ns + 1)
        return is_late and not step.state.idle and self.pause is None

    def _is_quiet(self, step: SegmentStep, needed_ns: float) -> bool:
        quiet, state = self._quiet, step.state
        return state.moves and quiet is not None and state.at_ns - quiet.since_ns >= needed_ns

    def is_rested(self, step: SegmentStep) -> bool:
        """Whether rest has lasted for long enough (rules 4, 5 and 8)."""
        quiet, held, at_ns, pause = self._quiet, self._held, step.state.at_ns, self.pause
        if quiet is None or step.state.rest < 0.5:
            return False
        needed_ns = self._hold_ns
        if self.decision is None:
            is_awaited = step.named is None and held is not None and held.agreed_ns is not None
            needed_ns *= 2 if is_awaited else 1
        elif pause is not None:
            needed_ns = pause.rest_ns
        else:
            lasted_ns = quiet.since_ns - self.decision.began_ns
            needed_ns /= 2 if lasted_ns >= self._lasting(self.decision.label).shortest_ns else 1
            if quiet.clear_ns is None or at_ns - quiet.clear_ns < needed_ns:
                needed_ns = max(self._hold_ns, PAUSE_S * SECOND_NS)
        return at_ns - quiet.since_ns >= needed_ns


GUARDS: Mapping[Event, Callable[[Conditions, SegmentStep], bool]] = {
    Event.MOVES: lambda _, step: step.state.observed and not step.state.idle,
    Event.MOVES_AGAIN: lambda _, step: step.state.rest < 0.5,
    Event.RESTS: lambda _, step: step.state.rest >= 0.5,
    Event.LEFT: lambda _, step: step.state.moves and step.state.idle,
    Event.NAMED: lambda known, step: known.nameable(step) is not None,
    Event.RESTED: Conditions.is_rested,
    Event.MISSED: Conditions.is_missed,
    Event.SEEN: Conditions.is_seen,
    Event.RETURNS: Conditions.is_back,
    Event.CONFIRMED: Conditions.is_confirmed,
    Event.NEXT: Conditions.is_next,
    Event.ANOTHER: Conditions.is_other,
    Event.MOVES_ON: Conditions.is_moving_on,
    Event.PREMATURE: Conditions.is_premature,
    Event.RENAMED: lambda known, _: known.renamed() is not None,
    Event.OUTAGE: lambda _, step: step.gap_ns > OUTAGE_S * SECOND_NS,
    Event.OUTAGE_IN_MOTION: lambda _, step: step.gap_ns > OUTAGE_S * SECOND_NS and not step.state.idle,
    Event.OUTAGE_AT_REST: lambda _, step: step.gap_ns > OUTAGE_S * SECOND_NS and step.state.idle,
    Event.LONG_OUTAGE_AT_REST: lambda _, step: step.gap_ns > HIDING_S * SECOND_NS and step.state.idle,
    Event.LONG_OUTAGE: lambda _, step: step.gap_ns > ENDING_S * SECOND_NS,
}
