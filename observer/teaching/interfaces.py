"""What teaching needs of the outside: the takes on the disk, and a learner that works in the background."""

from collections.abc import Sequence
from typing import Protocol

from common.teaching_messages import LearnedReport, Unwanted
from observer.motion.archive import MotionArchive, Recording


class Learner(Protocol):
    """Learns a model in the background: `observer.teaching.model_learner.ModelLearner`."""

    busy: bool
    """Whether it is learning."""
    fault: str
    """Why the last attempt failed; "" if it did not."""
    learned: LearnedReport | None
    """The model that waits to be adopted."""

    def learn(self, labels: Sequence[str]) -> None:
        """Begin to learn these movements from the takes on the disk."""

    def adopt(self, in_s: float) -> None:
        """Put the learned model in force after so many seconds."""

    def forget(self, unwanted: Unwanted, *, in_force: bool) -> int:
        """Remove models that were learned from it; the one in force only if that is asked. Returns how many."""

    def knows(self, unwanted: Unwanted) -> bool:
        """Whether the model in force was learned from it."""


class Takes(Protocol):
    """The takes on the disk: `observer.teaching.takes_file.TakesFile`."""

    @property
    def takes(self) -> dict[str, list[int]]:
        """Numbers of the takes of each movement."""

    @property
    def persons(self) -> dict[str, dict[str, int]]:
        """How many of each movement, by whose they are."""

    @property
    def archive(self) -> MotionArchive | None:
        """All of them, and something else; None for nothing."""

    @property
    def other_s(self) -> float:
        """Seconds of something else."""

    def start(self, labels: Sequence[str], *, add: bool) -> None:
        """Begin, or go on."""

    def add(self, recording: Recording) -> None:
        """Write one more."""

    def take(self, label: str, trial: str) -> Recording | None:
        """One of them; None if there is none."""

    def drop(self, label: str, trial: str) -> int:
        """Remove one."""

    def free_take(self, label: str) -> int:
        """A number that no take of the movement has."""

    def forget(self, unwanted: Unwanted) -> Sequence[Recording]:
        """Remove these from all files; returns them."""

    def write_waiting(self) -> None:
        """Write what could not be written."""

    def finish(self) -> None:
        """The takes have been learned."""
