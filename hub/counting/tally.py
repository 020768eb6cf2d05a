"""How often a movement has been done since somebody began to count, and when a target is reached. Pure.

1. What is in progress counts live by its judgements, and what has ended by its last verdict.
2. A movement that is repeated counts as often as the referee says; any other once, from its verdict on.
3. A revised verdict takes its count back. A movement that began before the tally does not count.
"""

from collections import OrderedDict
from dataclasses import dataclass

from common.messages import JudgementMessage, VerdictMessage

OPEN_LIMIT = 64
"""Movements whose verdict may still change; the counts of older ones stay as they are."""


@dataclass(frozen=True, slots=True)
class MovementTally:
    """How often so far. partial: how many of them went less far than usual. target: of one set; 0: none."""

    movement: str
    done: int = 0
    partial: int = 0
    target: int = 0

    @property
    def sets(self) -> int:
        """How often the target has been reached."""
        return self.done // self.target if self.target else 0

    @property
    def in_set(self) -> int:
        """How many in the set that is under way; the target itself until the next one begins."""
        if not self.target or not self.done:
            return self.done
        return (self.done - 1) % self.target + 1

    @property
    def is_complete(self) -> bool:
        """Whether the last repetition was the last one of a set."""
        return bool(self.sets) and self.done % self.target == 0


class RepetitionTally:
    """Counts one movement; `update` returns whether the tally has changed, and `reached` counts targets.

    since_ns: by the clock of the fusion machine; None: since the first judgement that arrives.
    """

    def __init__(self, movement: str, target: int = 0, since_ns: int | None = None) -> None:
        self._movement, self._target, self._since_ns = movement, target, since_ns
        self._open: OrderedDict[str, tuple[int, int]] = OrderedDict()
        self._before = (0, 0)
        self.now = MovementTally(movement, target=target)
        self.reached = 0
        """How many targets were reached; it does not go back when a verdict is revised."""

    def update(self, message: JudgementMessage) -> bool:
        """Take in a judgement or verdict."""
        if self._since_ns is None:
            self._since_ns = message.at_ns
        before = self.now
        if isinstance(message, VerdictMessage):
            self._note(message.id, message.label, message.began_ns, message)
        elif message.movement is not None and message.movement.label is not None:
            self._note(message.movement.id, message.movement.label, message.movement.began_ns, message)
        counts = [self._before, *self._open.values()]
        done, partial = (sum(each) for each in zip(*counts, strict=True))
        self.now = MovementTally(self._movement, done, partial, self._target)
        self.reached = max(self.reached, self.now.sets)
        return self.now != before

    def reset(self, target: int | None = None) -> None:
        """Count from 0 on again; what is in progress counts from its next repetition on. target: None: as before."""
        open_done, open_partial = next(reversed(self._open.values()), (0, 0))
        self._before, self._target = (-open_done, -open_partial), self._target if target is None else target
        last = next(reversed(self._open), None)
        self._open = OrderedDict() if last is None else OrderedDict({last: (open_done, open_partial)})
        self.now, self.reached = MovementTally(self._movement, target=self._target), 0

    def _note(self, movement_id: str, label: str, began_ns: int, message: JudgementMessage) -> None:
        if self._since_ns is not None and began_ns < self._since_ns and movement_id not in self._open:
            return
        if label != self._movement:
            self._open.pop(movement_id, None)
            return
        done = 1 if message.repetitions is None else message.repetitions
        known, _ = self._open.get(movement_id, (0, 0))
        # A judgement between two verdicts, or of a service that has just taken over, may be behind.
        if done >= known or isinstance(message, VerdictMessage):
            self._open[movement_id] = (max(done, known), message.partial_repetitions or 0)
        while len(self._open) > OPEN_LIMIT:
            _, (settled, partial) = self._open.popitem(last=False)
            self._before = self._before[0] + settled, self._before[1] + partial


def tally_words(tally: MovementTally) -> str:
    """`8`, `8 of 10`, `2 of 10, set 2`, and `, two of them partial`."""
    words = str(tally.in_set)
    if tally.target:
        number = tally.sets + (not tally.is_complete)
        words += f" of {tally.target}" + (f", set {number}" if number > 1 else "")
    if tally.partial:
        which = "all" if tally.partial >= tally.done else f"{tally.partial} of them" if tally.done > 1 else "it"
        words += f", {which} partial"
    return words
