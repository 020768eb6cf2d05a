"""What a lesson needs of the outside: answers of observers, a clock, a screen and keys. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

from common.messages import VerdictMessage
from common.teaching_messages import TeachReply

StepKind = Literal[
    "look", "ready", "waiting", "countdown", "now", "kept", "failed", "between", "review", "doubt", "other", "learning",
    "learned", "adopting", "test", "alarms", "examples", "done",
]  # fmt: skip
ActionKind = Literal["go", "begin", "repeat", "drop", "more", "skip", "pause"]
LOOK_S = 0.2
"""How often a lesson looks at answers, keys and pictures."""
Begin = Literal["now", "key", "clap", "still"]
"""With what the takes of a movement begin: at once, a key, a clap of the hands, or somebody who stands still."""


@dataclass(frozen=True, slots=True)
class Answers:
    """The replies by observer; those that were asked and did not answer."""

    replies: Mapping[str, TeachReply]
    silent: tuple[str, ...] = ()

    @property
    def faults(self) -> dict[str, str]:
        """Why an observer did not do what was asked."""
        return {name: reply.fault for name, reply in self.replies.items() if reply.fault}


@dataclass(frozen=True, slots=True)
class Step:
    """What the lesson does now, for a terminal or a page.

    kind: `look` for somebody to be seen; `ready` before a movement or, with label "", before something else;
    `waiting` for the sign to begin, which `how` names; `countdown` and `now` of a take, or of the test; `kept` or
    `failed` after a take; `between` two takes; `review` after a movement; `doubt`: the take `number` looks like another
    movement, and may be repeated; `other`: something else is recorded; `learning`; `learned` before the new models come
    into force; `adopting`; `test` before the test; `alarms`: verdicts count as false now; `examples` of movements that
    were missed, before anybody learns from them; `done`. label: the movement.
    number, of: which take of how many; observers that have learned. left_s: seconds to go, of a countdown or of
    something else; seconds since the beginning while observers learn.
    """

    kind: StepKind
    label: str = ""
    number: int = 0
    of: int = 0
    left_s: float = 0.0
    is_test: bool = False
    how: Begin = "now"


@dataclass(frozen=True, slots=True)
class Action:
    """What a person presses, or that nothing was pressed.

    go: nothing, so the lesson goes on. begin: begin the takes for which the lesson waits. repeat: remove the take with
    go: nothing, so the lesson goes on. begin: begin the takes that the lesson waits for. repeat: remove the take with
    this part out. pause: wait after this take.
    """

    kind: ActionKind
    take: int = 0


GO = Action("go")


class LessonInterface(Protocol):
    """What a lesson needs of the outside: `labanmesh teach` has a terminal, the dashboard a page, a test neither."""

    def pause(self, seconds: float) -> None:
        """Let time pass; raises KeyboardInterrupt when the teacher ends the lesson."""

    def now_s(self) -> float:
        """Seconds of a monotonic clock."""

    def say(self, line: str) -> None:
        """Show a line."""

    def show(self, step: Step) -> None:
        """Show what happens now: a countdown, a progress."""

    def between(self, step: Step, seconds: float) -> Action:
        """What is pressed within so many seconds; GO for nothing."""

    def ready(self, step: Step) -> Action:
        """What is pressed where a person may want to look or to rest first; a terminal goes on at once."""

    def fused_labels(self) -> Sequence[str]:
        """The movements that the fusion service judges now; empty while they are unknown."""

    def verdicts(self) -> Sequence[VerdictMessage]:
        """What the fusion service has decided since the last call; each movement once."""
