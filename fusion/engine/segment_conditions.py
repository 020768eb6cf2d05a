"""What the segmenter has observed, what was decided, and the events of its table with their conditions. Pure.

The rules are those of segmenter.py. Times: Unix epoch in ns.
"""

from collections.abc import Callable
from dataclasses import replace
from enum import Enum
from math import inf

from common import SECOND_NS
from common.config_sections import FusionConfig
from common.message_types import PAUSE_S
from common.vocabulary import Vocabulary
from fusion.engine.rest import CLEAR_MARGIN
from fusion.engine.segments import (
    ANY,
    NOTICED_NS,
    OUTAGE_NS,
    UNKNOWN,
    Durations,
    Heard,
    HeldLabel,
    MovementDecision,
    MovementProgress,
    PooledState,
    Quiet,
    SegmentState,
    SegmentStep,
    durations_of,
)

REVISED_NS = 1.0 * SECOND_NS
"""A premature decision is over after this."""
REVISIONS_LIMIT = 3
"""Of one movement, so that labels in turn give no endless series of verdicts; wire.md promises it."""
FADING = 2
"""In multiples of `hold_s`: so long a label has to be unlikely before its movement has ended."""
ENDING_NS = 5.0 * SECOND_NS
"""After a longer outage the same label is another movement (rule 9)."""
CLEAR_REST = 1.0 - CLEAR_MARGIN
"""Pooled rest, the median of the observers, that is no tie of two that contradict each other (rule 4)."""
NO_LABEL, UNDECIDED = HeldLabel("", 0, 0, None), MovementDecision("", 0, 0)
"""In place of a label and a decision where there is none."""

IDLE, PASSED = SegmentState.IDLE, SegmentState.PASSED
ENDING = (SegmentState.ENDING, SegmentState.SETTLED)
RESTING = (SegmentState.PAUSED, SegmentState.LOST, *ENDING)


class Conditions:
    """What is known of the movement in progress, and whether an event shows in a step."""

    def __init__(self, config: FusionConfig, vocabulary: Vocabulary) -> None:
        self._config, self._hold_ns = config, config.hold_s * SECOND_NS
        self._durations = durations_of(config, vocabulary)
        self.state = IDLE
        self._movement, self._held = MovementProgress(0, unseen=True), NO_LABEL
        """While the person is IDLE, the movement has the time and the label of the last end (`after`)."""
        self._heard: Heard | None = None
        self._quiet: Quiet | None = None
        self._last_ns = 0
        self._wait_ns = 0.0, inf
        """How long, and since when, observers of the roster are waited for; 0: they are not (rule 10)."""

    @property
    def movement(self) -> MovementProgress | None:
        """The movement that goes on; None at rest."""
        return None if self.state is IDLE else self._movement

    @property
    def waits(self) -> bool:
        """Whether observers of the roster are waited for (rule 10)."""
        return self._wait_ns[0] > 0.0

    @property
    def _decision(self) -> MovementDecision:
        return self._movement.decision or UNDECIDED

    def lasting(self, label: str) -> Durations:
        """How long movements with a label last."""
        return self._durations.get(label, UNKNOWN)

    @property
    def _lasts(self) -> Durations:
        return self.lasting(self._decision.label)

    @property
    def _resting(self) -> Quiet | None:
        """Since when the person rests; None while they move."""
        return self._quiet if self.state in RESTING else None

    def observe(self, state: PooledState) -> SegmentStep:
        """Take what is pooled at one step."""
        captured_ns = state.at_ns if state.newest_capture_ns is None else state.newest_capture_ns
        heard_ns = self._hear(captured_ns) if state.observed else captured_ns
        if captured_ns - heard_ns > OUTAGE_NS:
            self._heard, self._held = Heard(captured_ns, state.at_ns), NO_LABEL
            self._contest(None)
        before = self._held if self._held_for(self._last_ns) else None
        self._last_ns = state.at_ns
        self._hold(state, self.state in ENDING and state.rests)
        if self.state is IDLE and self._movement.unseen is state.observed and (state.idle or not state.observed):
            # Who comes into view is as unknown as the first one.
            self._movement = replace(self._movement, unseen=not state.observed)
        if self.state is not IDLE and (state.rest < 0.5 or self.state in RESTING):
            self._note_unseen(state)
        met, named = self._held_for(state.at_ns), self._held_for(state.at_ns - state.longer_s * SECOND_NS)
        if met != named:
            self._contest(met)
        return SegmentStep(state, named, before, heard_ns, captured_ns - heard_ns)

    def _hear(self, newest_ns: int) -> int:
        """Remember the newest capture, of this or of another service; returns the one before (rule 9)."""
        last_ns, since_ns = self._heard or (newest_ns, None)
        self._heard = Heard(max(newest_ns, last_ns), since_ns)
        return last_ns

    def _contest(self, label: str | None) -> None:
        if self.state is not IDLE and label != self._movement.contested:
            self._movement = replace(self._movement, contested=label)

    def _hold(self, state: PooledState, still: bool) -> None:
        """Remember the likeliest label. still: the person rests after a decided movement, so the label held stays."""
        held, at_ns = self._held, state.at_ns
        is_same = held.label == state.label and at_ns - held.last_ns <= NOTICED_NS
        if state.p < self._config.threshold:
            if held.agreed_ns is not None and not still:
                self._held = held._replace(agreed_ns=None)
        elif still and held.label:
            self._held = held._replace(last_ns=at_ns) if is_same else held
        else:
            since_ns, agreed_ns = (held.since_ns, held.agreed_ns) if is_same else (at_ns, None)
            agreed_ns = at_ns if agreed_ns is None else agreed_ns
            is_agreed = state.agreeing >= self._config.quorum
            self._held = HeldLabel(state.label, since_ns, at_ns, agreed_ns if is_agreed else None)

    def _note_unseen(self, state: PooledState) -> None:
        """Note since when the movement is not seen, and since when that is beyond doubt."""
        is_resting, at_ns, quiet = state.rests, state.at_ns, self._quiet
        if not is_resting and (self._goes_on(state) or not state.observed):
            self._quiet = None
            return
        has_rested = self.state in RESTING and not self._lasts.periodic
        if quiet is None or (has_rested and not is_resting):
            quiet = Quiet(at_ns, None)
        is_clear = state.rest >= CLEAR_REST if is_resting else state.unlearned >= self._config.threshold
        if is_clear is (quiet.clear_ns is None):
            quiet = Quiet(quiet.since_ns, at_ns if is_clear else None)
        self._quiet = quiet

    def _held_for(self, at_ns: float) -> str | None:
        """The label that meets the demand, and does so for `hold_s` at `at_ns` (rule 2)."""
        agreed_ns = self._held.agreed_ns
        return self._held.label if agreed_ns is not None and at_ns - agreed_ns >= self._hold_ns else None

    def _goes_on(self, state: PooledState) -> bool:
        """Whether the movement goes on: its label is the likeliest, and at least half as likely as demanded.

        Before the decision any label will do. Another label that fewer than `quorum` observers hold changes nothing,
        because the other observers may have just begun.
        """
        decision, is_alone = self._decision, state.agreeing < self._config.quorum
        stays = 2 * state.p >= self._config.threshold if state.label == decision.label else is_alone
        return (stays or decision is UNDECIDED) and not state.idle

    def _begin(self, at_ns: int) -> None:
        """Begin a movement, with the label that was held before it (rules 3 and 9)."""
        held, after_outage_ns = self._held, None if self._heard is None else self._heard.since_ns
        carried = held.label if at_ns - held.last_ns <= NOTICED_NS <= at_ns - held.since_ns else None
        if after_outage_ns is not None and 0 <= at_ns - after_outage_ns < NOTICED_NS:
            carried = ANY
        last, self._quiet = self._movement, None
        if last.decision is not None:
            last = MovementProgress(at_ns, after=last.decision.label)
        after = last.after if at_ns - last.began_ns <= NOTICED_NS else ""
        self._movement = MovementProgress(at_ns, None, carried, self.waits, last.unseen, after)
        if held.agreed_ns is not None:
            self._held = held._replace(agreed_ns=max(at_ns, held.agreed_ns))

    def _finish(self, is_idle: bool = True) -> None:
        """End the movement. is_idle: whether the person has rested, or done something else, since it was last seen."""
        unseen = not is_idle and self._decision is not UNDECIDED
        self._movement = MovementProgress(self._last_ns, unseen=unseen, after=self._decision.label)
        self.state, self._quiet = IDLE, None

    def nameable(self, step: SegmentStep) -> str | None:
        """The label that may be decided now (rules 1 to 3)."""
        movement, at_ns, quiet, label = self._movement, step.state.at_ns, self._resting, step.named
        if label is None and quiet is not None and quiet.since_ns == at_ns:
            label = self._held.label if self._held.agreed_ns else movement.contested
        if label is None or self.is_short(at_ns, label) or step.hides:
            return None
        # Of simulated observers that die, freeze and start, none held the previous label for longer than 0.5 s.
        is_carried = movement.carried in (ANY, label) and at_ns - movement.began_ns < 2 * NOTICED_NS
        return None if is_carried and (quiet is None or not step.state.observed) else label

    def is_short(self, at_ns: int, label: str | None) -> bool:
        """Whether the person has moved for too short a time for a movement with this label, or without one (rule 1)."""
        movement, moved_until_ns = self._movement, at_ns if self._resting is None else self._resting.since_ns
        before = movement.carried or (movement.after if label is None else "")
        least_ns = self.lasting(before).least_ns if before and label in (None, before) else 0.0
        unseen_ns = (inf if movement.after else NOTICED_NS) if label is None and movement.unseen else 0.0
        return moved_until_ns - movement.began_ns < max(self._hold_ns, least_ns, unseen_ns)

    def renamed(self) -> str | None:
        """The label that replaces the decided one at rest (rule 6)."""
        decision, quiet = self._decision, self._quiet
        if quiet is None or self._movement.outage_ns is not None:
            return None
        label = self._held_for(quiet.since_ns)
        return label if label != decision.label and decision.revisions < REVISIONS_LIMIT else None

    def is_revoked(self, step: SegmentStep) -> bool:
        """Whether "something else" was likely as rest began, so that the decided label is taken back (rule 6)."""
        quiet, at_ns = self._quiet, step.state.at_ns
        if self._decision is UNDECIDED or self._lasts.periodic or quiet is None or quiet.clear_ns is None:
            return False
        return at_ns - quiet.clear_ns >= NOTICED_NS and at_ns - quiet.since_ns < FADING * self._hold_ns

    def _is_seen(self, step: SegmentStep) -> bool:
        decision, state = self._decision, step.state
        return state.observed and state.label == decision.label and state.at_ns > decision.decided_ns

    def _is_confirmed(self, step: SegmentStep) -> bool:
        return self._movement.outage_ns is not None and step.named == self._decision.label

    def _is_other(self, step: SegmentStep) -> bool:
        return step.named is not None and self._is_challenged(step.state)

    def _is_challenged(self, state: PooledState) -> bool:
        """Whether another label than the decided one meets the demand, if not yet for long enough (rule 2)."""
        return self._held.agreed_ns is not None and state.moves and self._held.label != self._decision.label

    def _is_next(self, step: SegmentStep) -> bool:
        moved_ns = (self._held.agreed_ns or 0) - self._movement.began_ns
        is_late = self._movement.outage_ns is not None or moved_ns >= max(NOTICED_NS, self._lasts.over_ns)
        return is_late and self._is_other(step)

    def _is_premature(self, step: SegmentStep) -> bool:
        moved_ns, decided_ns = (self._held.agreed_ns or 0) - self._movement.began_ns, self._decision.decided_ns
        is_due = moved_ns < self._lasts.over_ns or step.state.at_ns - decided_ns >= REVISED_NS
        return is_due and self._is_other(step) and self._decision.revisions < REVISIONS_LIMIT

    def _is_missed(self, step: SegmentStep) -> bool:
        decision = self._decision
        is_open = decision is not UNDECIDED and decision.revisions < REVISIONS_LIMIT
        if is_open and self.state is not PASSED and self._is_challenged(step.state):
            return False
        if self._lasts.periodic:
            return self._is_quiet(step, self._lasts.other_ns)
        pause_ns = PAUSE_S * SECOND_NS if decision is not UNDECIDED and step.state.idle else 0.0
        return self._is_quiet(step, max(FADING * self._hold_ns, pause_ns))

    def _is_quiet(self, step: SegmentStep, needed_ns: float) -> bool:
        quiet, state = self._quiet, step.state
        return state.moves and quiet is not None and state.at_ns - quiet.since_ns >= needed_ns

    def _is_rested(self, step: SegmentStep) -> bool:
        quiet, at_ns, needed_ns, lasts = self._quiet, step.state.at_ns, self._hold_ns, self._lasts
        if quiet is None or step.state.rest < 0.5:
            return False
        if self._decision is UNDECIDED:
            needed_ns *= 2 if step.named is None and self._held.agreed_ns is not None else 1
        elif lasts.periodic:
            needed_ns = lasts.rest_ns
        else:
            needed_ns /= 2 if quiet.since_ns - self._decision.began_ns >= lasts.shortest_ns else 1
            if quiet.clear_ns is None or at_ns - quiet.clear_ns < needed_ns:
                needed_ns = max(self._hold_ns, PAUSE_S * SECOND_NS)
        return at_ns - quiet.since_ns >= needed_ns


class Event(Enum):
    """What a step shows, and the condition for it."""

    MOVES = "a movement is likelier than rest and something else", lambda _, step: step.state.begins
    MOVES_AGAIN = "the rest is over", lambda _, step: not step.state.rests
    RESTS = "the person is at rest", lambda _, step: step.state.rests
    NAMED = "a label may be decided", lambda known, step: known.nameable(step) is not None
    RESTED = "rest has lasted for long enough", Conditions._is_rested
    MISSED = "without rest, it has not been seen for long enough", Conditions._is_missed
    SEEN = "its label is the likeliest one, after the decision", Conditions._is_seen
    RETURNS = "its label is likely enough again", lambda known, step: step.state.observed and known._goes_on(step.state)
    CONFIRMED = "its label is held again after an outage", Conditions._is_confirmed
    LEFT = "something else is likelier", lambda _, step: step.state.moves and step.state.idle
    NEXT = "another label is held, since later than the begin", Conditions._is_next
    ANOTHER = "another label is held", Conditions._is_other
    PREMATURE = "another label is held before this one can be over, or long afterwards", Conditions._is_premature
    RENAMED = "another label, or something else, was held as rest began", lambda known, _: known.renamed() is not None
    OUTAGE = "an outage is over", lambda _, step: step.is_out
    OUTAGE_IN_MOTION = "an outage is over, and the person moves", lambda _, step: step.is_out and not step.state.idle
    OUTAGE_AT_REST = "an outage is over, and the person does not move", lambda _, step: step.is_out and step.state.idle
    LONG_OUTAGE_AT_REST = "the outage may hide a movement", lambda _, step: step.hides and step.state.idle
    LONG_OUTAGE = "the same label would be another movement", lambda _, step: step.gap_ns > ENDING_NS

    def __init__(self, meaning: str, shows: Callable[[Conditions, SegmentStep], bool]) -> None:
        self.meaning, self.shows = meaning, shows
