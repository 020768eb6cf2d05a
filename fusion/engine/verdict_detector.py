"""From the pooled posterior over time to one verdict per movement. Pure: time is passed in.

The design: fusion.md, "From belief to verdict", with the same numbers of rules.

1. A movement begins when neither rest nor "something else" is likelier than it. Motion shorter than `hold_s` is no
   movement.
2. A label is decided when it has been at least `threshold` likely and at least `quorum` observers have voted for it,
   without a break, for `hold_s`; or as soon as the person comes to rest, because waiting would show nothing more. A
   label that the observers held before the movement began is decided later (previous_label.py).
3. The movement ends when rest has been likelier for `hold_s`, at the time when that rest began. If another label met
   rule 2 when the person came to rest, that label replaces the decided one at once (a revision): the observers have
   then seen the whole movement. Later posteriors only fade, and an observer that is stuck would win. If "something
   else" had then been at least `threshold` likely for REVOKED_S, the revision is an abstention; for less long it may
   be the rest itself, which is something else too. A movement is revised at most REVISIONS_LIMIT times; its end repeats
   the last label.
4. A movement that ends undecided waits up to another `hold_s` for a label that meets the demand but not yet for long
   enough. Without one it is an abstention: the person moved, and the observers did not agree on a label.
5. After the clock was set back, detection starts afresh, because earlier durations mean nothing.
6. A standby service follows the owner: its movement and decision are the owner's. Which label meets the demand, and
   for how long, is its own observation, so that it can continue where the owner stops.
7. People go from one movement into the next without rest. A decided movement also ends when "something else" has been
   likelier, or its label neither the likeliest nor half as likely as demanded, for FADING times `hold_s`; and when
   another label meets rule 2 that began to do so at least NEXT_S after the movement's begin, or after "something else"
   was likelier: that is the next movement. If the other label began earlier and still holds REVISED_S after the
   decision, the decision was premature and is revised.
   An undecided movement that turns into something else was none, and gets no verdict.
8. After an outage (outage.py), in which no posterior was pooled for longer than OUTAGE_S, a movement that was not
   decided before begins afresh with the next motion, and a decided one is not revised: it ends with the last posterior
   before the outage, unless the same label goes on. After more than ENDING_OUTAGE_S it ends at once: a service that is
   killed again and again might not live to see the rest. After more than HIDING_OUTAGE_S the label that observers hold
   at rest may be that of a later movement, so that the undecided one becomes an abstention.
"""

from dataclasses import replace

from common import SECOND_NS
from common.config_sections import FusionConfig
from common.vocabulary import ABSTAIN
from fusion.engine.movement import LabelCandidate, MovementDecision, MovementProgress, PooledState
from fusion.engine.outage import Outage
from fusion.engine.previous_label import PreviousLabel

REVISIONS_LIMIT = 3
"""Of one movement, so that labels in turn give no endless series of verdicts."""
FADING = 2
"""In multiples of `hold_s`: so long a label has to be unlikely before its movement has ended."""
NEXT_S, REVISED_S = 0.3, 1.0
"""Movements of people do not follow one another faster than the first; a premature decision is over by the second."""
REVOKED_S = 0.3
"""Observers call rest "something else" for up to so long, before they notice that the person is still."""


class VerdictDetector:
    """Finds begin, decision and end of each movement."""

    def __init__(self, config: FusionConfig) -> None:
        self._config = config
        self._hold_ns = config.hold_s * SECOND_NS
        self._last_ns = 0
        self._label_at_rest: str | None = None
        self._revisions = 0
        self._candidate: LabelCandidate | None = None
        self._rest_since_ns: int | None = None
        self._faded_since_ns: int | None = None
        self._observed_decision_ns: int | None = None
        self._unlearned_since_ns: int | None = None
        self._outage = Outage()
        self._previous = PreviousLabel()
        self._deferred_label: str | None = None
        self._was_idle = self._is_tail = False
        self._is_observed = True
        self.movement: MovementProgress | None = None
        """The movement that goes on; None at rest."""

    @property
    def basis_times(self) -> frozenset[int]:
        """The times of the steps on which later verdicts may be based: decisions, and the begin of rest."""
        if self.movement is None:
            return frozenset()
        decision = self.movement.decision
        times = (None if decision is None else decision.decided_ns, self._rest_since_ns)
        return frozenset([at_ns for at_ns in times if at_ns is not None])

    @property
    def held_since_ns(self) -> int | None:
        """Since when the label has met the demand without a break; None while it does not."""
        return None if self._candidate is None else self._candidate.since_ns

    @property
    def outage_ns(self) -> int | None:
        """When the decided movement was seen last before an outage that may have hidden its end; None without one."""
        return self._outage.since_ns

    def follow(
        self, movement: MovementProgress | None, newest_capture_ns: int | None = None, outage_ns: int | None = None
    ) -> None:
        """Take over the state of another service, or of this one before a restart (rule 6).

        newest_capture_ns: of the posteriors that service had, if it is known. outage_ns: its own.
        """
        if movement is None:
            self._finish()
        elif self.movement is None:
            self._begin(movement.began_ns)
        elif movement.decision is None:
            self._label_at_rest = None
        self.movement = movement
        self._outage.follow(newest_capture_ns, None if movement is None else movement.decision, outage_ns)

    def update(self, state: PooledState) -> tuple[MovementDecision, ...]:
        """Take one step; returns the decisions that are due: the first one, a revision, an end."""
        if state.at_ns < self._last_ns:
            self._finish()
            self._outage, self._previous = Outage(), PreviousLabel()
        self._last_ns = at_ns = state.at_ns
        self._is_observed = state.observed
        self._detect_outage(state)
        if self._outage.ends_movement:
            ended = self.end_now(self._outage.since_ns or at_ns)
            return () if ended is None else (ended,)
        if state.observed and state.p >= self._config.threshold:
            self._previous.record_label(state.label, at_ns)
        if self.movement is None and (state.idle or not state.observed):
            return ()
        movement = self.movement or self._begin(at_ns)
        label = self._held_label(state)
        is_else, since_ns = state.unlearned >= self._config.threshold, self._unlearned_since_ns
        self._unlearned_since_ns = None if not is_else else at_ns if since_ns is None else since_ns
        if not state.observed or state.rest >= 0.5:
            self._faded_since_ns = None
        elif (decisions := self._update_without_rest(movement, state, label)) is not None:
            return decisions
        was_moving = self._rest_since_ns is None
        self._update_rest(movement, state, label)
        if was_moving and self._rest_since_ns is not None and self._candidate is not None:
            label = self._candidate.label
        decision = self._revision(movement)
        if decision is None and movement.decision is None:
            decision = self._first_decision(movement, label, at_ns)
        if decision is not None:
            self.movement = movement = MovementProgress(movement.began_ns, decision)
        end = self._end(movement, label, at_ns) if self._is_over(movement, label, at_ns) else None
        return tuple([due for due in (decision, end) if due is not None])

    def end_now(self, at_ns: int) -> MovementDecision | None:
        """End the movement at `at_ns`, whatever the person does; its end if it was decided, else None."""
        decision = None if self.movement is None else self.movement.decision
        self._finish()
        self._candidate = self._rest_since_ns = self._observed_decision_ns = None
        return None if decision is None else replace(decision, ended_ns=at_ns, stage="ended")

    def _detect_outage(self, state: PooledState) -> None:
        """Rule 8: notice that posteriors arrive again after an outage."""
        if not state.observed:
            return
        decision = None if self.movement is None else self.movement.decision
        captured_ns = state.at_ns if state.newest_capture_ns is None else state.newest_capture_ns
        if self._outage.update(captured_ns, decision):
            self._previous.end_outage(state.at_ns)
        if self._outage.begins_afresh and self.movement is not None and decision is None and not state.idle:
            self._begin(state.at_ns)

    def _update_without_rest(
        self, movement: MovementProgress, state: PooledState, label: str | None
    ) -> tuple[MovementDecision, ...] | None:
        """Apply rule 7 to a step without rest; returns the decisions that are due, None if the movement goes on."""
        decision, at_ns = movement.decision, state.at_ns
        is_likeliest = decision is None or state.label == decision.label
        if decision is not None and is_likeliest:
            self._observed_decision_ns = decision.decided_ns
        self._was_idle = decision is not None and (self._was_idle or state.idle)
        if not state.idle and is_likeliest and (decision is None or 2 * state.p >= self._config.threshold):
            self._faded_since_ns = None
        elif self._faded_since_ns is None:
            self._faded_since_ns = at_ns
        if decision is not None and label is not None and label != decision.label:
            return self._replace(movement, decision, label, at_ns)
        if label is not None:
            self._outage.since_ns = None
        if self._faded_since_ns is None or at_ns - self._faded_since_ns < FADING * self._hold_ns:
            return None
        ended_ns = self._outage.since_ns or self._faded_since_ns
        self._finish()
        if decision is not None:
            self._previous.end_movement(decision.label, ended_ns)
        return () if decision is None else (replace(decision, ended_ns=ended_ns, stage="ended"),)

    def _replace(
        self, movement: MovementProgress, decision: MovementDecision, label: str, at_ns: int
    ) -> tuple[MovementDecision, ...] | None:
        """Another label has met the demand (rule 7): the next movement, a revision, or None: neither yet."""
        since_ns = at_ns if self._candidate is None else self._candidate.since_ns
        # A service that has just taken over may have missed when the label changed.
        was_observed, outage_ns = self._observed_decision_ns == decision.decided_ns, self._outage.since_ns
        is_next = was_observed and (self._was_idle or since_ns - movement.began_ns >= NEXT_S * SECOND_NS)
        if is_next or outage_ns is not None:
            ended = replace(decision, ended_ns=since_ns if outage_ns is None else outage_ns, stage="ended")
            candidate = self._candidate
            self._begin(since_ns)
            self._candidate = candidate
            if self._previous.is_carried_over(label, since_ns, at_ns):
                return (ended,)
            first = MovementDecision(label, since_ns, at_ns)
            self.movement = MovementProgress(since_ns, first)
            return ended, first
        if at_ns - decision.decided_ns < REVISED_S * SECOND_NS or self._revisions >= REVISIONS_LIMIT:
            return None
        self._revisions += 1
        self._faded_since_ns = None
        revised = replace(decision, label=label, decided_ns=at_ns, stage="revised", revises=decision.label)
        self.movement = MovementProgress(movement.began_ns, revised)
        return (revised,)

    def _begin(self, at_ns: int) -> MovementProgress:
        """Begin a movement at `at_ns`."""
        self.movement = movement = MovementProgress(at_ns)
        self._candidate = self._rest_since_ns = self._label_at_rest = None
        self._faded_since_ns = self._unlearned_since_ns = self._deferred_label = None
        self._revisions, self._was_idle, self._is_tail = 0, False, False
        self._outage.begin_movement()
        self._previous.begin_movement(at_ns)
        return movement

    def _finish(self) -> None:
        """Forget the movement in progress."""
        self.movement = self._label_at_rest = None
        self._outage.end_movement()

    def _first_decision(self, movement: MovementProgress, label: str | None, at_ns: int) -> MovementDecision | None:
        """The decision of a movement that has none, if it is due (rule 2)."""
        deferred, self._deferred_label = self._deferred_label, None
        label = label or (deferred if self._rest_since_ns == at_ns else None)
        if self._rest_since_ns is not None and self._previous.is_tail(label, movement.began_ns, self._rest_since_ns):
            self._is_tail = True
            return None
        if label is None or not self._is_long_enough(movement, at_ns) or self._is_over(movement, label, at_ns):
            return None
        # If all observers have gone, unlike at rest, the label says nothing about a movement that has just begun.
        is_observed_rest = self._rest_since_ns is not None and self._is_observed
        if not is_observed_rest and self._previous.is_carried_over(label, movement.began_ns, at_ns):
            self._deferred_label = label
            return None
        return MovementDecision(label, movement.began_ns, at_ns)

    def _held_label(self, state: PooledState) -> str | None:
        """The label that has met the demand for `hold_s`, if any."""
        if self._outage.hides_label or state.p < self._config.threshold or state.agreeing < self._config.quorum:
            self._candidate = None
            return None
        if self._candidate is None or self._candidate.label != state.label:
            self._candidate = LabelCandidate(state.label, state.at_ns)
        return state.label if state.at_ns - self._candidate.since_ns >= self._hold_ns else None

    def _update_rest(self, movement: MovementProgress, state: PooledState, label: str | None) -> None:
        if state.rest < 0.5:
            self._rest_since_ns = self._label_at_rest = None
        elif self._rest_since_ns is None:
            self._rest_since_ns = state.at_ns
            since_ns = self._unlearned_since_ns
            is_revoked = since_ns is not None and state.at_ns - since_ns >= REVOKED_S * SECOND_NS
            last = ABSTAIN if is_revoked else label
            decision = None if self._outage.since_ns is not None else movement.decision
            if decision is not None and last not in (None, decision.label) and self._revisions < REVISIONS_LIMIT:
                self._label_at_rest = last
                self._revisions += 1

    def _revision(self, movement: MovementProgress) -> MovementDecision | None:
        """The revision that is due; once more if the service that this one follows has not published it (rule 6)."""
        decision, label = movement.decision, self._label_at_rest
        if decision is None or label is None or label == decision.label or self._rest_since_ns is None:
            return None
        return replace(decision, label=label, decided_ns=self._rest_since_ns, stage="revised", revises=decision.label)

    def _is_over(self, movement: MovementProgress, label: str | None, at_ns: int) -> bool:
        """Whether rest has lasted for long enough (rules 3 and 4)."""
        waits = movement.decision is None and label is None and self._candidate is not None
        needed_ns = 2 * self._hold_ns if waits else self._hold_ns
        return self._rest_since_ns is not None and at_ns - self._rest_since_ns >= needed_ns

    def _is_long_enough(self, movement: MovementProgress, at_ns: int) -> bool:
        """Rule 1: a flicker of rest is no movement, even if the last movement's label is still held."""
        moved_until_ns = at_ns if self._rest_since_ns is None else self._rest_since_ns
        return moved_until_ns - movement.began_ns >= self._hold_ns

    def _end(self, movement: MovementProgress, label: str | None, at_ns: int) -> MovementDecision | None:
        decision, ended_ns = movement.decision, self._outage.since_ns or self._rest_since_ns
        if decision is None and self._is_long_enough(movement, at_ns) and not self._is_tail:
            decision = MovementDecision(label or ABSTAIN, movement.began_ns, at_ns)
        self._finish()
        if decision is not None and ended_ns is not None:
            self._previous.end_movement(decision.label, ended_ns)
        return None if decision is None else replace(decision, ended_ns=ended_ns, stage="ended")
