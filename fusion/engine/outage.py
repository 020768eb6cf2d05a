"""Outages: times in which no posterior was pooled, and what they hide (rule 8 of verdict_detector.py). Pure.

Times are ns of the Unix epoch by the fusion machine's clock.
"""

from common import SECOND_NS
from fusion.engine.movement import MovementDecision

OUTAGE_S = 1.0
"""A shorter outage hides no whole movement, nor the whole rest between two."""
HIDING_OUTAGE_S = 2.0
"""A longer outage can hide a rest and a whole movement."""
ENDING_OUTAGE_S = 5.0
"""After a longer outage the same label is another movement."""


class Outage:
    """The newest capture time of a pooled posterior, and the effect of the last outage on the movement before it.

    since_ns: the newest capture before the outage, or the decision if that is later; None without an outage during the
    decided movement, or if its label went on after it. begins_afresh: no movement was decided, and an undecided one
    begins anew. hides_label: the label that observers hold may be that of a later movement. ends_movement: the decided
    movement is over, whatever the label.
    """

    def __init__(self) -> None:
        self._newest_capture_ns: int | None = None
        self.since_ns: int | None = None
        self.begins_afresh = self.hides_label = self.ends_movement = False

    def update(self, captured_ns: int, decision: MovementDecision | None) -> bool:
        """Take the newest capture time of a step; returns whether an outage ended before it.

        decision: on the movement in progress.
        """
        last_ns = captured_ns if self._newest_capture_ns is None else self._newest_capture_ns
        self._newest_capture_ns, gap_s = max(captured_ns, last_ns), (captured_ns - last_ns) / SECOND_NS
        if gap_s <= OUTAGE_S:
            return False
        self.since_ns = None if decision is None else max(last_ns, decision.decided_ns)
        self.begins_afresh, self.hides_label = decision is None, decision is None and gap_s > HIDING_OUTAGE_S
        self.ends_movement = decision is not None and gap_s > ENDING_OUTAGE_S
        return True

    def follow(self, captured_ns: int | None, decision: MovementDecision | None, since_ns: int | None = None) -> None:
        """Take the newest capture time of another service, which has made `decision`; None: unknown.

        since_ns: of the outage that the other service has noticed, if it has. If this service had no posterior for an
        outage before the capture, the other one continues the movement from then.
        """
        self.begins_afresh = False
        self.since_ns = self.since_ns if since_ns is None else since_ns
        if captured_ns is None:
            return
        last_ns = captured_ns if self._newest_capture_ns is None else self._newest_capture_ns
        self._newest_capture_ns = max(captured_ns, last_ns)
        if since_ns is None and decision is not None and captured_ns - last_ns > OUTAGE_S * SECOND_NS:
            self.since_ns = max(last_ns, decision.decided_ns)

    def begin_movement(self) -> None:
        """Forget what was hidden: it was before the movement that begins."""
        self.since_ns, self.begins_afresh, self.hides_label = None, False, False

    def end_movement(self) -> None:
        """Forget the effect on the movement that has ended."""
        self.since_ns, self.hides_label, self.ends_movement = None, False, False
