"""Whether a label is of the movement before: what the observers named already when a movement began. Pure.

1. Posteriors keep the last movement's label at rest. When the next movement begins, observers that see it need some
   tenths of a second to change; one that is away, frozen or just started does not change at all. What they name in
   common until then is the movement before, which must not be decided again.
2. So a label that they had named for BEFORE_S when the movement began is decided no sooner than CARRIED_S after that,
   or when the person comes to rest. That all observers go is no rest.
3. A movement of the same label that begins within TAIL_S of the end of the one before, and lasts for less than
   CARRIED_S, is its tail, and gets no verdict: an observer that took a turn for rest ended it too soon.
4. As rule 2 is any label of a movement that begins within BEFORE_S of the end of a time in which nobody was heard.
"""

from common import SECOND_NS

BEFORE_S = 0.3
"""A label that was named for a shorter time may be of the new movement, where its begin was noticed late."""
CARRIED_S = 0.6
"""In a simulation of observers that die, freeze and start, none named the movement before for longer than .5 s."""

TAIL_S = 0.4
"""People rest for longer between two movements, or not at all; then the same label goes on without an end."""


class LabelBefore:
    """Remembers what the observers named when the movement in progress began."""

    def __init__(self) -> None:
        self._label: str | None = None
        self._since_ns = self._named_ns = 0
        self._heard_again_ns: int | None = None
        self._carried: str | None = None
        self._ended: tuple[str, int] | None = None
        self._tail: str | None = None
        self._carries_any = False

    def name(self, label: str, at_ns: int) -> None:
        """The observers name `label` in the step at `at_ns`."""
        if label != self._label or at_ns - self._named_ns > BEFORE_S * SECOND_NS:
            self._label, self._since_ns = label, at_ns
        self._named_ns = at_ns

    def hear_again(self, at_ns: int) -> None:
        """Observers are heard again at `at_ns`, after a time in which nobody was."""
        self._label, self._heard_again_ns = None, at_ns

    def end(self, label: str, ended_ns: int) -> None:
        """A movement that was decided to be `label` has ended."""
        self._ended = label, ended_ns

    def begin(self, at_ns: int) -> None:
        """A movement begins."""
        label, ended_ns = self._ended or ("", 0)
        self._tail = label if at_ns - ended_ns <= TAIL_S * SECOND_NS else None
        again_ns, long_ns = self._heard_again_ns, BEFORE_S * SECOND_NS
        is_named = at_ns - self._named_ns <= long_ns <= at_ns - self._since_ns
        self._carried = self._label if is_named else None
        self._carries_any = again_ns is not None and 0 <= at_ns - again_ns < long_ns

    def is_carried(self, label: str, began_ns: int, at_ns: int) -> bool:
        """Whether at `at_ns` it is too soon to decide `label` for the movement that began at `began_ns`."""
        is_old = self._carries_any or label in (self._carried, self._tail)
        return is_old and at_ns - began_ns < CARRIED_S * SECOND_NS

    def is_tail(self, label: str | None, began_ns: int, at_ns: int) -> bool:
        """Whether a movement from `began_ns` to `at_ns` is the tail of the movement before (3)."""
        return label is not None and label == self._tail and at_ns - began_ns < CARRIED_S * SECOND_NS
