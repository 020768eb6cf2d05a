"""A lesson as a page shows it: what happens now, and what people press on it. Safe for several threads.

1. Where the lesson waits (`ready`) one press counts: its number names the step that the person saw, so that of two
   people who press at once the second presses nothing by mistake.
2. While takes go on, presses wait for the pause after the take.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from common.errors import BadInput
from common.messages import VerdictMessage
from hub.teaching.correcting import MomentExample
from hub.teaching.interface import GO, Action, ActionKind, Step, StepKind
from hub.teaching.lesson import LessonPlan
from hub.teaching.wording import TYPED, reworded

LINES_LIMIT = 200
Purpose = Literal["lesson", "correct", "forget"]
"""What a page asks for at length."""
WAITING_ACTIONS: dict[StepKind, tuple[ActionKind, ...]] = {
    "ready": ("go", "skip"),
    "review": ("go", "more", "drop"),
    "learned": ("go", "skip"),
    "test": ("go", "skip"),
    "examples": ("go", "drop"),
}
"""What can be pressed where the lesson waits."""
RUNNING_ACTIONS: dict[StepKind, tuple[ActionKind, ...]] = {
    "waiting": ("begin",),
    **dict.fromkeys(("countdown", "now", "kept", "failed", "between"), ("pause", "repeat")),
    "doubt": ("repeat",),
    "other": ("skip",),
    "alarms": ("skip",),
}
"""What can be pressed meanwhile."""
MOVED_ON = "the lesson has moved on, perhaps by another phone; look at what it shows now"
PRESSED = "somebody else has just pressed something else"


@dataclass(frozen=True, slots=True)
class Line:
    """A line of the lesson, and the kind of step in which it was written."""

    text: str
    kind: StepKind
    is_test: bool


@dataclass(frozen=True, slots=True)
class Shown:
    """What a page shows of a lesson. number: of the step. waits: until somebody presses. lines: the newest ones."""

    step: Step
    number: int
    waits: bool
    lines: tuple[Line, ...]


class PageInterface:
    """A `LessonInterface`. changed: called after each change. fused_labels, verdicts: as in `LessonInterface`."""

    def __init__(
        self,
        changed: Callable[[], None],
        fused_labels: Callable[[], Sequence[str]],
        verdicts: Callable[[], Sequence[VerdictMessage]],
    ) -> None:
        self._changed = changed
        self.fused_labels, self.verdicts = fused_labels, verdicts
        self._condition = threading.Condition()
        self._shown = Shown(Step("look"), 0, False, ())
        self._pressed: deque[Action] = deque()
        self._last: tuple[int, Action] | None = None
        self._ended = False

    @property
    def shown(self) -> Shown:
        """What a page shows now."""
        return self._shown

    def now_s(self) -> float:
        """Seconds of a monotonic clock."""
        return time.monotonic()

    def pause(self, seconds: float) -> None:
        """Wait; raises KeyboardInterrupt after `end`."""
        self._wait(lambda: False, seconds)

    def say(self, line: str) -> None:
        """Add a line."""
        step = self._shown.step
        lines = (*self._shown.lines, Line(reworded(line, TYPED), step.kind, step.is_test))[-LINES_LIMIT:]
        self._set(replace(self._shown, lines=lines))

    def show(self, step: Step) -> None:
        """Show what happens now."""
        self._set(replace(self._shown, step=step, waits=False, number=self._shown.number + (step != self._shown.step)))

    def between(self, step: Step, seconds: float) -> Action:
        """The action pressed within so many seconds or during the take; GO if none was."""
        self.show(step)
        self._wait(lambda: bool(self._pressed), seconds)
        with self._condition:
            return self._pressed.popleft() if self._pressed else GO

    def ready(self, step: Step) -> Action:
        """Wait until somebody presses."""
        with self._condition:
            self._pressed.clear()
        self._set(Shown(step, self._shown.number + 1, True, self._shown.lines))
        self._wait(lambda: bool(self._pressed), None)
        with self._condition:
            action = self._pressed.popleft()
        self._set(replace(self._shown, waits=False))
        return action

    def press(self, number: int, action: Action) -> None:
        """Take the action of a person who saw step `number`; raises BadInput, one line, if it does not fit."""
        with self._condition:
            if (number, action) == self._last:
                return  # the same press of two people, or of one with a bad connection
            shown = self._shown
            waits = shown.waits
            if action.kind not in (WAITING_ACTIONS if waits else RUNNING_ACTIONS).get(shown.step.kind, ()):
                raise BadInput(MOVED_ON)
            if waits and number != shown.number:
                raise BadInput(MOVED_ON)
            if waits and self._pressed:
                raise BadInput(PRESSED)
            if action not in self._pressed:
                self._pressed.append(action)
            self._last = number, action
            self._condition.notify_all()

    def end(self) -> None:
        """End the lesson at its next pause."""
        with self._condition:
            self._ended = True
            self._condition.notify_all()

    def _wait(self, done: Callable[[], bool], seconds: float | None) -> None:
        with self._condition:
            self._condition.wait_for(lambda: self._ended or done(), seconds)
            if self._ended:
                raise KeyboardInterrupt

    def _set(self, shown: Shown) -> None:
        with self._condition:
            self._shown = shown
        self._changed()


@dataclass(slots=True)
class PageLesson:
    """A lesson, or what else observers are asked for at length, and how it ended. plan: of a lesson.

    examples: of movements that were missed. fault: one line; over: it goes on no more; stopped: because somebody
    pressed so.
    """

    id: str
    plan: LessonPlan | None
    interface: PageInterface
    purpose: Purpose = "lesson"
    examples: list[MomentExample] = field(default_factory=list)
    thread: threading.Thread | None = None
    over: bool = False
    stopped: bool = False
    fault: str = ""
