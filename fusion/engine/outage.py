"""Outages: times in which no observer was heard, and what they leave unknown (rule 8 of verdict_detector.py). Pure."""

from common import SECOND_NS
from fusion.engine.movement import MovementDecision

UNHEARD_S = 1.0
"""A shorter outage hides no whole movement, nor the whole rest between two."""
HIDDEN_S = 2.0
"""A longer outage can hide a rest and a whole movement."""
FORGOTTEN_S = 5.0
"""After a longer outage the same label is another movement."""


class Outage:
    """When observers were heard last, and what an outage means for the movement that was in progress before it.

    since_ns: when the decided movement was heard last; None if there was no outage since, or its label went on after
    it. is_past: there was no decided movement, and an undecided one is over. is_unknown: it has been over for so long
    that what observers name may be a later one. is_forgotten: the decided movement is over, whatever observers name.
    """

    def __init__(self) -> None:
        self._heard_ns: int | None = None
        self.since_ns: int | None = None
        self.is_past = self.is_unknown = self.is_forgotten = False

    def update(self, heard_ns: int, decision: MovementDecision | None) -> bool:
        """Observers were heard at `heard_ns`; whether that ends an outage. decision: on the movement in progress."""
        last_ns = heard_ns if self._heard_ns is None else self._heard_ns
        self._heard_ns, gap_s = max(heard_ns, last_ns), (heard_ns - last_ns) / SECOND_NS
        if gap_s <= UNHEARD_S:
            return False
        self.since_ns = None if decision is None else max(last_ns, decision.decided_ns)
        self.is_past, self.is_unknown = decision is None, decision is None and gap_s > HIDDEN_S
        self.is_forgotten = decision is not None and gap_s > FORGOTTEN_S
        return True

    def follow(self, heard_ns: int | None, decision: MovementDecision | None) -> None:
        """Another service, with this decision, heard observers at `heard_ns`; None: unknown.

        Where this service had heard none before for so long, the other one continues what was heard then.
        """
        self.is_past = False
        if heard_ns is None:
            return
        last_ns = heard_ns if self._heard_ns is None else self._heard_ns
        self._heard_ns = max(heard_ns, last_ns)
        if decision is not None and heard_ns - last_ns > UNHEARD_S * SECOND_NS:
            self.since_ns = max(last_ns, decision.decided_ns)

    def begin(self) -> None:
        """A movement begins: what an outage hid was before it."""
        self.since_ns, self.is_past, self.is_unknown = None, False, False

    def end(self) -> None:
        """The movement has ended."""
        self.since_ns, self.is_unknown, self.is_forgotten = None, False, False
