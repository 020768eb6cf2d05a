"""What the segmenter has observed: the label that is held, since when the movement is not seen, outages. Pure.

The rules are those of segmenter.py. Times: Unix epoch in ns.
"""

from dataclasses import dataclass

from common import SECOND_NS
from common.config_sections import FusionConfig
from fusion.engine.segment_table import SegmentState
from fusion.engine.segments import Heard, HeldLabel, MovementDecision, PooledState, Quiet

NOTICED_S = 0.3
"""Observers notice within so long that a movement has begun, has changed or is over: a label that is held for a shorter
time as one begins may be its own (rule 3), as may one that begins sooner after the begin (rule 7), and something else
that lasts for less may be rest (rule 6)."""
OUTAGE_S = 1.0
"""A shorter outage hides no whole movement, nor the whole rest between two (rule 9)."""
CLEAR_REST = 0.75
"""Pooled rest, the median of the observers, that is no tie of two that contradict each other (rule 4; see rest.py)."""
ANY = "*"
"""In place of the label that was held before a movement: it may have been any."""
ENDING = (SegmentState.ENDING, SegmentState.SETTLED)
RESTING = (SegmentState.PAUSED, SegmentState.LOST, *ENDING)


@dataclass(slots=True)
class SegmentStep:
    """One step: what is pooled; `named`, the label that meets rule 2; `before`, what was held until `last_ns`.

    gap_ns: from the newest posterior before, captured at `heard_ns`, to the newest one now.
    """

    state: PooledState
    named: str | None
    before: HeldLabel | None
    last_ns: int
    heard_ns: int
    gap_ns: int


class SegmentWatch:
    """Takes what is pooled, step by step."""

    def __init__(self, config: FusionConfig) -> None:
        self._threshold, self._quorum, self._hold_ns = config.threshold, config.quorum, config.hold_s * SECOND_NS
        self.held: HeldLabel | None = None
        """The label that is, or was last, likely enough."""
        self.quiet: Quiet | None = None
        """Since when the movement in progress is not seen."""
        self._heard: Heard | None = None
        self._last_ns = 0

    def turned_back(self, at_ns: int) -> bool:
        """Whether the clock was set back before a step at `at_ns`; then everything is forgotten (rule 12)."""
        if at_ns >= self._last_ns:
            return False
        self.held = self.quiet = self._heard = None
        return True

    def step(
        self, state: PooledState, known: SegmentState, decision: MovementDecision | None, repeated: bool
    ) -> SegmentStep:
        """Take one step. known: the segmenter's state; repeated: whether `decision` is on a periodic movement."""
        heard_ns, gap_ns = self._hear(state)
        before, last_ns, self._last_ns = self.held, self._last_ns, state.at_ns
        self._hold(state, known in ENDING and state.rest >= 0.5)
        if known is not SegmentState.IDLE and (state.rest < 0.5 or known in RESTING):
            self._miss(state, self.is_seen(state, decision), known in RESTING and not repeated)
        return SegmentStep(state, self.named(state.at_ns), before, last_ns, heard_ns, gap_ns)

    def named(self, at_ns: int) -> str | None:
        """The label that meets the demand, and does so for `hold_s` at `at_ns` (rule 2)."""
        held = self.held
        return held.label if held is not None and self._is_met(held, at_ns) else None

    def _is_met(self, held: HeldLabel, at_ns: int) -> bool:
        return held.agreed_ns is not None and at_ns - held.agreed_ns >= self._hold_ns

    def carried(self, began_ns: int) -> str | None:
        """The label that was held before a movement that begins then (rules 3 and 9)."""
        held, before_ns = self.held, NOTICED_S * SECOND_NS
        since_ns = None if self._heard is None else self._heard.since_ns
        if since_ns is not None and 0 <= began_ns - since_ns < before_ns:
            return ANY
        if held is None or not began_ns - held.last_ns <= before_ns <= began_ns - held.since_ns:
            return None
        return held.label

    def is_seen(self, state: PooledState, decision: MovementDecision | None) -> bool:
        """Whether the movement goes on: its label is likeliest and half as likely as demanded; undecided, any is."""
        is_own = decision is None or (state.label == decision.label and 2 * state.p >= self._threshold)
        return is_own and not state.idle

    def begin(self, at_ns: int) -> None:
        """A movement begins: the hold of its label begins, too."""
        self.quiet = None
        if self.held is not None and self.held.agreed_ns is not None:
            self.held = self.held._replace(agreed_ns=max(at_ns, self.held.agreed_ns))

    def rest(self, step: SegmentStep, label: str | None, since_ns: int | None) -> None:
        """Rest begins, or goes on since an earlier time. label: the one held until then instead of that in `step`."""
        at_ns, held, before = step.state.at_ns, self.held, step.before
        if label is not None:
            self.held = HeldLabel(label, at_ns, at_ns, at_ns - round(self._hold_ns))
        elif (held is None or held.agreed_ns is None) and before is not None and self._is_met(before, step.last_ns):
            self.held = before
        clear_ns = at_ns if step.state.rest >= CLEAR_REST else None
        self.quiet = Quiet(at_ns if since_ns is None else since_ns, clear_ns)

    def follow(self, newest_ns: int | None) -> int | None:
        """Take the newest capture of another service; returns when this one had its last, if an outage lies between."""
        if newest_ns is None:
            return None
        last_ns, since_ns = (newest_ns, None) if self._heard is None else self._heard
        self._heard = Heard(max(newest_ns, last_ns), since_ns)
        return last_ns if newest_ns - last_ns > OUTAGE_S * SECOND_NS else None

    def _hear(self, state: PooledState) -> tuple[int, int]:
        """Take the newest capture of a step; returns the one before, and the time between both (rule 9)."""
        if not state.observed:
            return 0, 0
        captured_ns = state.at_ns if state.newest_capture_ns is None else state.newest_capture_ns
        last_ns, since_ns = (captured_ns, None) if self._heard is None else self._heard
        if captured_ns - last_ns > OUTAGE_S * SECOND_NS:
            since_ns, self.held = state.at_ns, None
        self._heard = Heard(max(captured_ns, last_ns), since_ns)
        return last_ns, captured_ns - last_ns

    def _hold(self, state: PooledState, still: bool) -> None:
        """Take the likeliest label. still: a decided movement rests: posteriors only fade, and the label held stays."""
        held, at_ns = self.held, state.at_ns
        is_same = held is not None and held.label == state.label and at_ns - held.last_ns <= NOTICED_S * SECOND_NS
        if state.p < self._threshold:
            if held is not None and held.agreed_ns is not None and not still:
                self.held = held._replace(agreed_ns=None)
        elif held is not None and still:
            self.held = held._replace(last_ns=at_ns) if is_same else held
        else:
            since_ns, agreed_ns = (held.since_ns, held.agreed_ns) if held is not None and is_same else (at_ns, None)
            if state.agreeing < self._quorum:
                agreed_ns = None
            elif agreed_ns is None:
                agreed_ns = at_ns
            self.held = HeldLabel(state.label, since_ns, at_ns, agreed_ns)

    def _miss(self, state: PooledState, seen: bool, rested: bool) -> None:
        """Note since when the movement is not seen, and since when beyond doubt. rested: until now it was at rest."""
        is_resting, at_ns, quiet = state.rest >= 0.5, state.at_ns, self.quiet
        if not is_resting and (seen or not state.observed):
            self.quiet = None
            return
        if quiet is None or (rested and not is_resting):
            quiet = Quiet(at_ns, None)
        is_clear = state.rest >= CLEAR_REST if is_resting else state.unlearned >= self._threshold
        if is_clear is (quiet.clear_ns is None):
            quiet = Quiet(quiet.since_ns, at_ns if is_clear else None)
        self.quiet = quiet
