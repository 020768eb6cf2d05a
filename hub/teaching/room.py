"""What a lesson needs of the outside: answers of observers, and a room with a clock, a screen and keys. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from common.teaching_messages import TeachReply


@dataclass(frozen=True, slots=True)
class Answers:
    """The replies by observer; those that were asked and did not answer."""

    replies: Mapping[str, TeachReply]
    silent: tuple[str, ...] = ()

    @property
    def faults(self) -> dict[str, str]:
        """Why an observer did not do what was asked."""
        return {name: reply.fault for name, reply in self.replies.items() if reply.fault}


class Room(Protocol):
    """What a lesson needs of the outside: `labanmesh teach` has a terminal, a test has none."""

    def pause(self, seconds: float) -> None:
        """Let time pass; raises KeyboardInterrupt when the teacher ends the lesson."""

    def now_s(self) -> float:
        """Seconds of a monotonic clock."""

    def say(self, line: str) -> None:
        """Show a line."""

    def show(self, line: str) -> None:
        """Show what changes: a countdown, a progress."""

    def key(self, seconds: float) -> str:
        """The key that is pressed within so many seconds; "" without one, or without a keyboard."""

    def fused_labels(self) -> Sequence[str]:
        """The movements that the fusion service judges now; empty while they are unknown."""

    def verdicts(self) -> Sequence[str]:
        """The labels that the fusion service has decided since the last call."""
