"""The label of the previous movement, which observers still name when the next one begins. Pure.

The design: fusion.md, "From belief to verdict", 2, 3 and 8.

1. Posteriors keep the previous movement's label at rest. When the next movement begins, observers that see it need some
   tenths of a second to change; one that is away, frozen or just started does not change at all. The label that they
   hold in common until then is that of the previous movement, which must not be decided again.
2. So a label that they had held for BEFORE_S when the movement began is decided CARRY_OVER_S after its begin at the
   earliest, or when the person comes to rest. The absence of all observers is no rest.
3. A movement of the same label that begins within TAIL_S of the end of the previous one, and lasts for less than
   TAIL_LENGTH_S, is its tail, and gets no verdict: an observer that took a turn for rest, or has just started, ended
   the movement too soon. A longer one is decided after that time.
4. Any label of a movement that begins within BEFORE_S of the end of an outage is treated as in rule 2.
"""

from common import SECOND_NS

BEFORE_S = 0.3
"""A label that was held for a shorter time may be of the new movement, if its begin was noticed late."""
CARRY_OVER_S = 0.6
"""In a simulation of observers that die, freeze and start, none held the previous label for longer than 0.5 s."""

TAIL_S = 0.4
"""People rest for longer between two movements, or not at all; without a rest the same label has no end."""
TAIL_LENGTH_S = 0.8
"""In storms, tails lasted for up to 0.6 s."""


class PreviousLabel:
    """Remembers which label the observers held when the movement in progress began. Times: Unix epoch in ns."""

    def __init__(self) -> None:
        self._label: str | None = None
        self._since_ns = self._last_ns = 0
        self._outage_end_ns: int | None = None
        self._carried_over: str | None = None
        self._ended: tuple[str, int] | None = None
        self._tail: str | None = None
        self._carries_over_any = False

    def record_label(self, label: str, at_ns: int) -> None:
        """Take the label that is likely enough in the step at `at_ns`."""
        if label != self._label or at_ns - self._last_ns > BEFORE_S * SECOND_NS:
            self._label, self._since_ns = label, at_ns
        self._last_ns = at_ns

    def end_outage(self, at_ns: int) -> None:
        """Note that an outage, without posteriors of any observer, ended at `at_ns`."""
        self._label, self._outage_end_ns = None, at_ns

    def end_movement(self, label: str, ended_ns: int) -> None:
        """Note that a movement that was decided to be `label` has ended."""
        self._ended = label, ended_ns

    def begin_movement(self, at_ns: int) -> None:
        """Note that a movement begins at `at_ns`."""
        label, ended_ns = self._ended or ("", 0)
        self._tail = label if at_ns - ended_ns <= TAIL_S * SECOND_NS else None
        outage_end_ns, before_ns = self._outage_end_ns, BEFORE_S * SECOND_NS
        was_held = at_ns - self._last_ns <= before_ns <= at_ns - self._since_ns
        self._carried_over = self._label if was_held else None
        self._carries_over_any = outage_end_ns is not None and 0 <= at_ns - outage_end_ns < before_ns

    def is_carried_over(self, label: str, began_ns: int, at_ns: int) -> bool:
        """Whether at `at_ns` it is too soon to decide `label` for the movement that began at `began_ns`."""
        if self.is_tail(label, began_ns, at_ns):
            return True
        is_previous = self._carries_over_any or label == self._carried_over
        return is_previous and at_ns - began_ns < CARRY_OVER_S * SECOND_NS

    def is_tail(self, label: str | None, began_ns: int, at_ns: int) -> bool:
        """Whether a movement from `began_ns` to `at_ns` is the tail of the movement before (rule 3)."""
        return label is not None and label == self._tail and at_ns - began_ns < TAIL_LENGTH_S * SECOND_NS
