"""The segmenter: from the pooled posterior over time to one verdict for each movement. Pure: time is passed in.

The table of transitions is segment_table.py: (state, event) -> (state, what is published). The design: fusion.md,
"Segments", with the same numbers.

1. A movement begins when neither rest nor "something else" is likelier than it. Motion shorter than `hold_s` is none;
   nor is it, with the label of the one before, if it lasts for less than half of that label's shortest take, less
   NOTICED_S at its begin: it is the end of that one, after a pause.
2. A label is decided when it has been `threshold` likely, with the votes of `quorum` observers, without a break, for
   `hold_s`, or NOTICED_S longer where one of three contests it; or, contested or not, as soon as the person rests.
3. A label that was held for NOTICED_S as the movement began is of the one before: posteriors keep it at rest. It is
   decided CARRIED_S after the begin at the earliest, or at rest. That all observers have gone is no rest.
4. The movement ends, at the time when rest began, when rest has been beyond doubt for `hold_s`, or for half of it once
   it has lasted as long as a take. Rest in which observers contradict each other ends it after PAUSE_S.
5. An undecided movement that ends waits up to another `hold_s` for a label that meets the demand but not yet for long
   enough. Without one it is an abstention. One that turns into something else was none, unless a label was contested.
6. If another label met rule 2 when the person came to rest, it replaces the decided one (a revision). If something else
   had been `threshold` likely for NOTICED_S, that is an abstention. There are at most REVISIONS_LIMIT; the end repeats
   the last label.
7. Without rest, a decided movement also ends when its label has been neither likeliest nor half as likely as demanded
   for FADING times `hold_s`, or while the person does something else for PAUSE_S; and when another label meets rule 2
   that began to do so NOTICED_S after the begin and no sooner than the first can be over (rule 1), or after something
   else: the next movement. One that began earlier revises it, at the latest REVISED_S after the decision.
8. A periodic label is one movement for as long as it is repeated: rest and something else end it only after the pause
   of `durations_of`, when the last repetition was seen. Any other label is a new movement each time.
9. After an outage, in which no posterior was pooled for OUTAGE_S, an undecided movement begins afresh with the next
   motion (rule 3). If the person rests, the label held decides it; after HIDING_S that is an abstention. A decided
   movement ends when it was seen last before the outage, unless its label is held again; after ENDING_S at once.
10. While observers of the roster have not begun, a movement is `early`: as an abstention it is none. The wait is over
    for good when each has sent something, or as long after the first posterior as `wait` says.
11. A service that follows another one takes its movement and decision; which label is held is its own observation.
12. After the clock was set back everything but the wait of rule 10 begins afresh.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

from common import SECOND_NS
from common.config_sections import FusionConfig
from common.vocabulary import ABSTAIN, Vocabulary
from fusion.engine.segment_conditions import (
    CLEAR_REST,
    ENDING,
    GUARDS,
    OUTAGE_S,
    RESTING,
    Conditions,
)
from fusion.engine.segment_table import FOLLOWED, TABLE, Effect, Event, SegmentState, Transition
from fusion.engine.segments import (
    Heard,
    HeldLabel,
    MovementDecision,
    MovementProgress,
    PooledState,
    Quiet,
    RepetitionCount,
    SegmentStep,
    Start,
    carried_label,
    durations_of,
)

GUARDED = {state: tuple((GUARDS[row.event], row) for row in rows) for state, rows in TABLE.items()}
Published = Sequence[MovementDecision]


class Segmenter(Conditions):
    """Finds begin, decision and end of each movement. Times: Unix epoch in ns."""

    def __init__(self, config: FusionConfig, vocabulary: Vocabulary) -> None:
        super().__init__(config, vocabulary)
        self._config = config
        self._start: Start | None = None

    @property
    def basis_times(self) -> frozenset[int]:
        """The times of the steps on which later verdicts may be based: decisions, and the begin of rest."""
        decision, quiet = self.decision, self._resting
        if decision is None and quiet is None:
            return frozenset()
        times = (None if decision is None else decision.decided_ns, None if quiet is None else quiet.since_ns)
        return frozenset([at_ns for at_ns in times if at_ns is not None])

    @property
    def held_since_ns(self) -> int | None:
        """Since when the label has met the demand without a break; None while it does not."""
        return None if self._held is None else self._held.agreed_ns

    @property
    def shown(self) -> MovementProgress | None:
        """The movement in progress as it is published: while observers are waited for without its label."""
        return replace(self.movement, decision=None) if self.movement is not None and self.waits else self.movement

    @property
    def repetitions(self) -> RepetitionCount | None:
        """How often the movement in progress has been done so far, if it is periodic and its label is published."""
        return None if self.decision is None or self.waits else self.decision.repetitions

    def counts(self, label: str) -> bool:
        """Whether a label is periodic, so that its repetitions are counted."""
        return self._lasting(label).pause is not None

    @property
    def waits(self) -> bool:
        """Whether observers of the roster are waited for (rule 10)."""
        return self._start is not None

    def wait(self, grace_s: float) -> None:
        """Wait for the observers of the roster, at most `grace_s` seconds after the first posterior; 0: no more."""
        self._start = Start(round(grace_s * SECOND_NS)) if grace_s > 0 else None

    def change_vocabulary(self, vocabulary: Vocabulary) -> None:
        """Take the durations of movements in `vocabulary` from now on."""
        self._durations = durations_of(self._config, vocabulary)

    def update(self, state: PooledState) -> tuple[MovementDecision, ...]:
        """Take one step; returns the decisions that are due: a first one, a revision, an end."""
        if state.at_ns < self._last_ns:
            self._held = self._heard = None
            self._finish()
        step = self.observe(state)
        published: tuple[MovementDecision, ...] = ()
        taken: tuple[Event, ...] = ()
        while (row := self._due(step, taken)) is not None:
            published = (*published, *EFFECTS[row.effect](self, step))
            self.state, taken = row.state, (*taken, row.event)
            if row.state is SegmentState.IDLE:
                self._finish()
                break
        if state.repetitions is not None:
            self._count(state)
        if self._start is not None:
            self._start = self._start.after(state)
        return published

    def _due(self, step: SegmentStep, taken: Collection[Event]) -> Transition | None:
        """The transition that is due, of those not taken in this step; looked for at each step, so plainly."""
        for guard, row in GUARDED[self.state]:
            if guard(self, step) and row.event not in taken:
                return row
        return None

    def follow(
        self, movement: MovementProgress | None, newest_capture_ns: int | None = None, outage_ns: int | None = None
    ) -> None:
        """Take over the state of another service, or of this one before a restart (rule 11).

        newest_capture_ns: of the posteriors that service had, if it is known. outage_ns: its own.
        """
        missed_ns = None if newest_capture_ns is None else self._follow_captures(newest_capture_ns)
        if movement is None:
            self._finish()
            return
        own, decision = self.movement or self._begin(movement.began_ns), movement.decision
        followed = replace(own, began_ns=movement.began_ns, decision=decision, early=False, outage_ns=None)
        if decision is None:
            self.state, self.movement = FOLLOWED.get(self.state, self.state), followed
            return
        if outage_ns is None and missed_ns is not None:
            outage_ns = max(missed_ns, decision.decided_ns)
        if outage_ns is None and own.outage_ns is not None and own.outage_ns >= movement.began_ns:
            outage_ns = own.outage_ns
        before, quiet = own.decision, self._quiet
        is_same = before is not None and (own.began_ns, before.label) == (movement.began_ns, decision.label)
        if self.state in RESTING and quiet is not None and movement.began_ns <= quiet.since_ns:
            self.state = SegmentState.SETTLED
        elif outage_ns is not None:
            self.state = SegmentState.PASSED
        elif not is_same:
            self.state, self._quiet = SegmentState.UNSEEN, None
        if before is not None and is_same:
            counts = [count for count in (before.repetitions, decision.repetitions) if count is not None]
            decision = replace(decision, revisions=before.revisions, repetitions=max(counts, default=None))
        self.movement = replace(followed, decision=decision, outage_ns=outage_ns)

    def _follow_captures(self, newest_ns: int) -> int | None:
        """Take the newest capture of another service; returns when this one had its last, if an outage lies between."""
        last_ns, since_ns = (newest_ns, None) if self._heard is None else self._heard
        self._heard = Heard(max(newest_ns, last_ns), since_ns)
        return last_ns if newest_ns - last_ns > OUTAGE_S * SECOND_NS else None

    def end_now(self, at_ns: int) -> MovementDecision | None:
        """End the movement at `at_ns`, whatever the person does; its end if it was decided, else None."""
        decision, self._held = self.decision, None
        self._finish()
        return None if decision is None else replace(decision, ended_ns=at_ns, stage="ended")

    def _finish(self) -> None:
        self.state, self.movement, self._quiet, self._contested = SegmentState.IDLE, None, None, None

    def _begin(self, at_ns: int) -> MovementProgress:
        carried = carried_label(self._held, self._heard, at_ns)
        self.movement = MovementProgress(at_ns, None, carried, self._start is not None)
        self._quiet = self._contested = None
        if self._held is not None and self._held.agreed_ns is not None:
            self._held = self._held._replace(agreed_ns=max(at_ns, self._held.agreed_ns))
        return self.movement

    def _begin_now(self, step: SegmentStep) -> Published:
        self._begin(step.state.at_ns)
        return ()

    def _begin_next(self, step: SegmentStep) -> Published:
        """End the movement, and begin that of the label that is held, since it has been."""
        held, quiet = self._held, self._quiet
        since_ns = step.state.at_ns if held is None or held.agreed_ns is None else held.agreed_ns
        ended = self._end(step, None, since_ns if self.pause is None or quiet is None else quiet.since_ns)
        self._begin(since_ns)
        return ended

    def _begin_next_now(self, step: SegmentStep) -> Published:
        ended = self._end(step, None, None)
        self._begin(step.state.at_ns)
        return ended

    def _rest(self, step: SegmentStep) -> Published:
        """Rest begins, or of a periodic movement goes on since it was seen last; what is held then stays."""
        at_ns, held, quiet = step.state.at_ns, self._held, self._quiet
        if self.is_revoked(step):
            self._held = HeldLabel(ABSTAIN, at_ns, at_ns, at_ns - round(self._hold_ns))
        elif held is None or held.agreed_ns is None:
            self._held = step.before or held
        since_ns = at_ns if self.pause is None or quiet is None else quiet.since_ns
        self._quiet = Quiet(since_ns, at_ns if step.state.rest >= CLEAR_REST else None)
        return ()

    def _drop(self, step: SegmentStep) -> Published:
        return () if self._contested is None else self._end(step, self._contested, None)

    def _miss(self, step: SegmentStep) -> Published:
        if self.movement is not None and self.decision is not None:
            outage_ns = max(step.heard_ns, self.decision.decided_ns)
            self.movement, self._quiet = replace(self.movement, outage_ns=outage_ns), None
        return ()

    def _confirm(self, step: SegmentStep) -> Published:
        if self.movement is not None:
            self.movement = replace(self.movement, outage_ns=None)
        return ()

    def _decide(self, step: SegmentStep) -> Published:
        movement, label = self.movement, self.nameable(step)
        if movement is None or label is None:
            return ()
        return self._publish(MovementDecision(label, movement.began_ns, step.state.at_ns), step)

    def _revise(self, step: SegmentStep) -> Published:
        """Replace the label: by the one that was held as rest began, or in motion by the one that is held now."""
        decision, quiet, is_resting = self.decision, self._quiet, self.state in ENDING
        label = self.renamed() if is_resting else step.named
        if decision is None or label is None:
            return ()
        at_ns = quiet.since_ns if is_resting and quiet is not None else step.state.at_ns
        self._quiet = quiet if is_resting else None
        revised = replace(decision, label=label, decided_ns=at_ns, stage="revised", revises=decision.label)
        return self._publish(replace(revised, revisions=decision.revisions + 1, repetitions=None), step)

    def _publish(self, decision: MovementDecision, step: SegmentStep) -> Published:
        if self.movement is not None:
            self.movement = replace(self.movement, decision=decision)
        self._count(step.state)
        return () if self.decision is None else (self.decision,)

    def _end_now(self, step: SegmentStep) -> Published:
        return self._end(step, self.nameable(step), None)

    def _end(self, step: SegmentStep, label: str | None, ended_ns: int | None) -> Published:
        """End the movement when it was seen last, or at `ended_ns`; undecided, with `label`."""
        movement, decision, quiet, at_ns = self.movement, self.decision, self._quiet, step.state.at_ns
        if movement is None:
            return ()
        if decision is None and not self.is_short(at_ns, label) and (label is not None or not movement.early):
            decision = MovementDecision(label or ABSTAIN, movement.began_ns, at_ns)
        quiet_ns = at_ns if quiet is None else quiet.since_ns
        ended_ns = movement.outage_ns or (quiet_ns if ended_ns is None else ended_ns)
        return () if decision is None else (replace(decision, ended_ns=ended_ns, stage="ended"),)

    def _count(self, state: PooledState) -> None:
        """Take how often a periodic movement has been done so far."""
        movement, decision, count = self.movement, self.decision, state.repetitions
        if count is None or movement is None or decision is None or self.pause is None:
            return
        if state.label == decision.label and (decision.repetitions is None or count > decision.repetitions):
            self.movement = replace(movement, decision=replace(decision, repetitions=count))


EFFECTS: Mapping[Effect, Callable[[Segmenter, SegmentStep], Published]] = {
    Effect.NOTHING: lambda *_: (),
    Effect.BEGIN: Segmenter._begin_now,
    Effect.REST: Segmenter._rest,
    Effect.DROP: Segmenter._drop,
    Effect.MISS: Segmenter._miss,
    Effect.CONFIRM: Segmenter._confirm,
    Effect.DECIDE: Segmenter._decide,
    Effect.REVISE: Segmenter._revise,
    Effect.END: Segmenter._end_now,
    Effect.NEXT: Segmenter._begin_next,
    Effect.NEXT_NOW: Segmenter._begin_next_now,
}
