"""The segmenter: from the pooled posterior over time to one verdict for each movement. Pure: time is passed in.

A table of transitions, (state, event) -> (state, what is published), at the end. Its rules, in short; in full and with
their reasons: fusion.md, "Segments".

1. A movement begins when neither rest nor "something else" is likelier than it. What is too short is none: the first,
   for what observers need to notice rest. Nor is one without a label that follows a decided one without either.
2. A label is decided when it has met threshold and quorum for `hold_s`, or for longer while an observer contests it.
3. A label that was held as the movement began is of the one before, and is decided late, or at rest.
4. A decided movement ends, at the time when rest began, when rest has lasted.
5. An undecided one that ends is decided by then, or an abstention. One that turns into something else was none.
6. Another label, or something else, that was held as rest began replaces the decided one, REVISIONS_LIMIT times.
7. Without rest, a decided movement ends when its label is no longer likely, or when that of the next one is held.
8. A periodic label is one movement for as long as it is repeated. Any other is a new movement each time.
9. After an outage of the posteriors it is unknown what the person did.
10. While observers of the roster have not begun, a movement is `early`: as an abstention it is none.
11. A service that follows another one takes its movement and decision; which label is held is its own observation.
12. After the clock was set back everything but the wait of rule 10 begins afresh.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from math import inf

from common import SECOND_NS
from common.vocabulary import ABSTAIN, Vocabulary
from fusion.engine.segment_conditions import CLEAR_REST, NO_LABEL, RESTING, Conditions, Event
from fusion.engine.segments import (
    OUTAGE_NS,
    HeldLabel,
    MovementDecision,
    MovementProgress,
    PooledState,
    Quiet,
    SegmentState,
    SegmentStep,
    durations_of,
)

IDLE, MOVING, PAUSED, LOST, DECIDED, PASSED, UNSEEN, ENDING, SETTLED = SegmentState
Published = Sequence[MovementDecision]


class Segmenter(Conditions):
    """Finds begin, decision and end of each movement. Times: Unix epoch in ns."""

    @property
    def basis_times(self) -> frozenset[int]:
        """The times of the steps on which later verdicts may be based: decisions, and the begin of rest."""
        quiet, decision = self._resting, self._movement.decision
        times = (None if decision is None else decision.decided_ns, None if quiet is None else quiet.since_ns)
        return frozenset([at_ns for at_ns in times if at_ns is not None])

    @property
    def held_since_ns(self) -> int | None:
        """Since when the label has met the demand without a break; None while it does not."""
        return self._held.agreed_ns

    @property
    def shown(self) -> MovementProgress | None:
        """The movement in progress as it is published: while observers are waited for without its label."""
        movement = self.movement
        return replace(movement, decision=None) if movement is not None and self.waits else movement

    def wait(self, grace_s: float) -> None:
        """Wait for the observers of the roster, at most `grace_s` seconds after the first posterior; 0: no more."""
        self._wait_ns = grace_s * SECOND_NS, inf

    def change_vocabulary(self, vocabulary: Vocabulary) -> None:
        """Take the durations of movements in `vocabulary` from now on."""
        self._durations = durations_of(self._config, vocabulary)

    def update(self, state: PooledState) -> tuple[MovementDecision, ...]:
        """Take one step; returns the decisions that are due: a first one, a revision, an end."""
        if state.at_ns < self._last_ns:
            self._held, self._heard = NO_LABEL, None
            self._finish()
        step = self.observe(state)
        published: tuple[MovementDecision, ...] = ()
        taken: tuple[Event, ...] = ()
        while (row := self._due(step, taken)) is not None:
            published = (*published, *row.effect.publishes(self, step))
            passed, self.state, taken = self.state is PASSED, row.state, (*taken, row.event)
            if row.state is IDLE:
                self._finish(passed or state.idle)
                break
        if state.repetitions is not None:
            self._count(state)
        if self.waits:
            grace_ns, first_ns = self._wait_ns[0], min(self._wait_ns[1], state.at_ns)
            is_over = state.complete or state.at_ns - first_ns >= grace_ns
            self._wait_ns = 0.0 if is_over else grace_ns, first_ns
        return published

    def _due(self, step: SegmentStep, taken: Collection[Event]) -> "Transition | None":
        """The transition that is due, of those not taken in this step."""
        for row in TABLE[self.state]:
            if row.event.shows(self, step) and row.event not in taken:
                return row
        return None

    def follow(
        self, movement: MovementProgress | None, newest_capture_ns: int | None = None, outage_ns: int | None = None
    ) -> None:
        """Take over the state of another service, or of this one before a restart (rule 11).

        newest_capture_ns: of the posteriors that service had, if it is known. outage_ns: its own.
        """
        last_ns = None if newest_capture_ns is None else self._hear(newest_capture_ns)
        if movement is None:
            self._finish()
            return
        if self.state is IDLE:
            self._begin(movement.began_ns)
        own, before, decision = self._movement, self._movement.decision, movement.decision
        followed = replace(
            own, began_ns=movement.began_ns, decision=decision, early=False, unseen=False, outage_ns=None
        )
        if decision is None:
            self._movement = followed
            if self.state is IDLE or before is not None:
                self.state = PAUSED if self.state in RESTING else MOVING
            return
        if outage_ns is None and last_ns is not None and (newest_capture_ns or 0) - last_ns > OUTAGE_NS:
            outage_ns = max(last_ns, decision.decided_ns)
        if outage_ns is None and own.outage_ns is not None and own.outage_ns >= movement.began_ns:
            outage_ns = own.outage_ns
        quiet = self._resting
        is_same = before is not None and (own.began_ns, before.label) == (movement.began_ns, decision.label)
        if quiet is not None and movement.began_ns <= quiet.since_ns:
            self.state = SETTLED
        elif outage_ns is not None:
            self.state = PASSED
        elif not is_same:
            self.state, self._quiet = UNSEEN, None
        if before is not None and is_same:
            counts = [count for count in (before.repetitions, decision.repetitions) if count is not None]
            decision = replace(decision, revisions=before.revisions, repetitions=max(counts, default=None))
        self._movement = replace(followed, decision=decision, outage_ns=outage_ns)

    def end_now(self, at_ns: int) -> MovementDecision | None:
        """End the movement at `at_ns`, whatever the person does; its end if it was decided, else None."""
        decision, self._held = self._movement.decision, NO_LABEL
        self._finish()
        return None if decision is None else replace(decision, ended_ns=at_ns, stage="ended")

    def _begin_next(self, step: SegmentStep) -> Published:
        """End the movement, and begin that of the label that is held, since it has been."""
        quiet = self._quiet if self._lasts.periodic else None
        since_ns = step.state.at_ns if self._held.agreed_ns is None else self._held.agreed_ns
        ended = self._end(step, None, since_ns if quiet is None else quiet.since_ns)
        self._begin(since_ns)
        return ended

    def _rest(self, step: SegmentStep) -> Published:
        """Rest begins, or of a periodic movement goes on since it was seen last; what is held then stays."""
        at_ns, quiet = step.state.at_ns, self._quiet if self._lasts.periodic else None
        if self.is_revoked(step):
            self._held = HeldLabel(ABSTAIN, at_ns, at_ns, at_ns - round(self._hold_ns))
        elif self._held.agreed_ns is None:
            self._held = step.before or self._held
        since_ns = at_ns if quiet is None else quiet.since_ns
        self._quiet = Quiet(since_ns, at_ns if step.state.rest >= CLEAR_REST else None)
        return ()

    def _drop(self, step: SegmentStep) -> Published:
        contested = self._movement.contested
        return () if contested is None else self._end(step, contested)

    def _miss(self, step: SegmentStep) -> Published:
        outage_ns = max(step.heard_ns, self._decision.decided_ns)
        self._movement, self._quiet = replace(self._movement, outage_ns=outage_ns), None
        return ()

    def _confirm(self, step: SegmentStep) -> Published:
        self._movement = replace(self._movement, outage_ns=None)
        return ()

    def _decide(self, step: SegmentStep) -> Published:
        label = self.nameable(step)
        return () if label is None else self._publish(self._named(label, step), step)

    def _named(self, label: str, step: SegmentStep) -> MovementDecision:
        return MovementDecision(label, self._movement.began_ns, step.state.at_ns)

    def _revise(self, step: SegmentStep) -> Published:
        """Replace the label: by the one that was held as rest began, or in motion by the one that is held now."""
        decision, quiet = self._decision, self._resting
        label = step.named if quiet is None else self.renamed()
        if label is None:
            return ()
        revised = MovementDecision(
            label, decision.began_ns, step.state.at_ns if quiet is None else quiet.since_ns, None, "revised",
            decision.label, decision.revisions + 1,
        )  # fmt: skip
        self._quiet = quiet
        return self._publish(revised, step)

    def _publish(self, decision: MovementDecision, step: SegmentStep) -> Published:
        self._movement = replace(self._movement, decision=decision)
        self._count(step.state)
        return (self._decision,)

    def _end(self, step: SegmentStep, label: str | None, ended_ns: int | None = None) -> Published:
        """End the movement when it was seen last, or at `ended_ns`; undecided, with `label`."""
        movement, decision, quiet, at_ns = self._movement, self._movement.decision, self._quiet, step.state.at_ns
        if decision is None and not self.is_short(at_ns, label) and (label is not None or not movement.early):
            decision = self._named(label or ABSTAIN, step)
        seen_ns = at_ns if quiet is None else quiet.since_ns
        ended_ns = movement.outage_ns or (seen_ns if ended_ns is None else ended_ns)
        return () if decision is None else (replace(decision, ended_ns=ended_ns, stage="ended"),)

    def _count(self, state: PooledState) -> None:
        """Take how often a periodic movement has been done so far."""
        decision, count = self._decision, state.repetitions
        if count is None or not self._lasts.periodic or state.label != decision.label:
            return
        if decision.repetitions is None or count > decision.repetitions:
            self._movement = replace(self._movement, decision=replace(decision, repetitions=count))


class Effect(Enum):
    """What follows an event."""

    NOTHING = "", lambda *_: ()
    BEGIN = "begins", lambda segmenter, step: segmenter._begin(step.state.at_ns) or ()
    REST = "rests", Segmenter._rest
    DROP = "no verdict, or ended with a label that was only contested", Segmenter._drop
    MISS = "may have ended", Segmenter._miss
    CONFIRM = "goes on", Segmenter._confirm
    DECIDE = "decided", Segmenter._decide
    REVISE = "revised", Segmenter._revise
    END = "ended", lambda segmenter, step: segmenter._end(step, segmenter.nameable(step))
    NEXT = "ended; the next begins when its label did", Segmenter._begin_next

    def __init__(self, meaning: str, publishes: Callable[[Segmenter, SegmentStep], Published]) -> None:
        self.meaning, self.publishes = meaning, publishes


@dataclass(frozen=True, slots=True)
class Transition:
    """In each of these states the event leads to `state`, with this effect, by the rule with this number."""

    states: tuple[SegmentState, ...]
    event: Event
    effect: Effect
    state: SegmentState
    rule: int


TRANSITIONS = (
    Transition((IDLE,), Event.MOVES, Effect.BEGIN, MOVING, 1),
    Transition((MOVING, PAUSED, LOST), Event.LONG_OUTAGE_AT_REST, Effect.END, IDLE, 9),
    Transition((MOVING, PAUSED, LOST), Event.OUTAGE_AT_REST, Effect.REST, LOST, 9),
    Transition((MOVING, PAUSED, LOST), Event.OUTAGE_IN_MOTION, Effect.BEGIN, MOVING, 9),
    Transition((MOVING,), Event.RESTS, Effect.REST, PAUSED, 5),
    Transition((MOVING,), Event.NAMED, Effect.DECIDE, UNSEEN, 2),
    Transition((MOVING,), Event.MISSED, Effect.DROP, IDLE, 5),
    Transition((PAUSED, LOST), Event.RESTED, Effect.END, IDLE, 5),
    Transition((PAUSED, LOST), Event.NAMED, Effect.DECIDE, SETTLED, 2),
    Transition((PAUSED,), Event.MOVES_AGAIN, Effect.NOTHING, MOVING, 5),
    Transition((LOST,), Event.MOVES, Effect.BEGIN, MOVING, 9),
    Transition((LOST,), Event.LEFT, Effect.DROP, IDLE, 9),
    Transition((DECIDED, PASSED, UNSEEN, ENDING, SETTLED), Event.OUTAGE, Effect.MISS, PASSED, 9),
    Transition((PASSED,), Event.LONG_OUTAGE, Effect.END, IDLE, 9),
    Transition((DECIDED, PASSED, UNSEEN), Event.RESTS, Effect.REST, ENDING, 4),
    Transition((DECIDED,), Event.CONFIRMED, Effect.CONFIRM, DECIDED, 9),
    Transition((DECIDED,), Event.NEXT, Effect.NEXT, MOVING, 7),
    Transition((PASSED,), Event.ANOTHER, Effect.NEXT, MOVING, 7),
    Transition((UNSEEN,), Event.SEEN, Effect.NOTHING, DECIDED, 7),
    Transition((DECIDED, UNSEEN), Event.PREMATURE, Effect.REVISE, DECIDED, 7),
    Transition((DECIDED, PASSED, UNSEEN), Event.MISSED, Effect.END, IDLE, 7),
    Transition((DECIDED,), Event.LEFT, Effect.NOTHING, PASSED, 7),
    Transition((PASSED,), Event.RETURNS, Effect.NOTHING, DECIDED, 7),
    Transition((ENDING, SETTLED), Event.RENAMED, Effect.REVISE, SETTLED, 6),
    Transition((ENDING, SETTLED), Event.RESTED, Effect.END, IDLE, 4),
    Transition((ENDING,), Event.MOVES_AGAIN, Effect.NOTHING, DECIDED, 4),
    Transition((SETTLED,), Event.MOVES_AGAIN, Effect.NOTHING, UNSEEN, 4),
)
TABLE = {state: tuple(row for row in TRANSITIONS if state in row.states) for state in SegmentState}
"""Of each state the events in the order in which they are looked for; a step takes transitions until none is due, each
event once, or until the person is IDLE."""
