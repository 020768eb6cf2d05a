"""The protocols of teaching's two neighbours: the takes on the disk, and a learner that works in the background."""

from collections.abc import Sequence
from typing import Protocol

from common.teaching_messages import EarlierTakes, LearnedReport, Unwanted
from observer.motion.archive import MotionArchive, Recording


class Learner(Protocol):
    """Learns a model in the background: `observer.teaching.model_learner.ModelLearner`."""

    busy: bool
    """Whether it is learning."""
    fault: str
    """Why the last attempt failed; "" if it did not."""
    learned: LearnedReport | None
    """The model that waits to be adopted."""

    def learn(self, labels: Sequence[str], references: Sequence[str] = ()) -> None:
        """Begin to learn these movements from the takes on the disk. references: LABEL:TRIAL of those to score by."""

    @property
    def references(self) -> frozenset[str]:
        """LABEL:TRIAL of the takes that are references of the model in force."""

    def adopt(self, in_s: float) -> None:
        """Put the learned model in force after this many seconds; raises LabanmeshError if that fails."""

    def forget(self, unwanted: Unwanted, *, in_force: bool) -> int:
        """Remove models that were learned from what is unwanted, the one in force only if asked; returns the number."""

    def knows(self, unwanted: Unwanted) -> bool:
        """Whether the model in force was learned from what is unwanted."""


class Takes(Protocol):
    """The takes on the disk: `observer.teaching.takes_file.TakesFile`."""

    @property
    def takes(self) -> dict[str, list[int]]:
        """Numbers of the takes of each movement."""

    @property
    def persons(self) -> dict[str, dict[str, int]]:
        """Number of recordings of each movement ("": something else) by each person."""

    @property
    def archive(self) -> MotionArchive | None:
        """All takes, and recordings of something else; None without any."""

    @property
    def other_s(self) -> float:
        """Seconds of something else."""

    @property
    def earlier(self) -> list[EarlierTakes]:
        """Takes that were set aside."""

    def start(self, labels: Sequence[str], *, add: bool, lesson: str) -> None:
        """Begin to teach these movements, or go on; add: keep the takes of earlier ones. lesson: its id."""

    def restore(self, wanted: str, lesson: str) -> None:
        """The earlier takes with the id `wanted` become the takes of now; raises BadInput for an unknown id."""

    def add(self, recording: Recording) -> None:
        """Write one more take; raises BadInput or LabanmeshError if it cannot be written."""

    def take(self, label: str, trial: str) -> Recording | None:
        """The take of that movement and number; None if there is none."""

    def drop(self, label: str, trial: str) -> int:
        """Remove a take; returns the number removed."""

    def free_take(self, label: str) -> int:
        """A number that no take of the movement has."""

    def forget(self, unwanted: Unwanted) -> Sequence[Recording]:
        """Remove what is unwanted from all files; returns the recordings removed."""

    def write_waiting(self) -> None:
        """Write the takes that could not be written before."""

    def finish(self) -> None:
        """The takes have been learned."""
