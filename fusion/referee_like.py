"""What the service around a referee needs of him; tests put others in his place."""

from collections.abc import Sequence
from typing import Protocol

from common.clock_skew import ClockReading
from common.messages import JudgementMessage, PosteriorMessage, VerdictMessage
from common.vocabulary import Vocabulary
from fusion.engine.reliability import Reliability


class EngineOutputLike(Protocol):
    """One step's result."""

    @property
    def judgement(self) -> JudgementMessage:
        """What the judges together believe now."""

    @property
    def verdicts(self) -> Sequence[VerdictMessage]:
        """What was decided in this step, if anything."""


class EngineLike(Protocol):
    """What the service needs of a referee."""

    @property
    def vocabulary(self) -> Vocabulary:
        """The movements that it judges."""

    def receive(self, observer: str, message: PosteriorMessage, now_ns: int) -> str | None:
        """Take one posterior; returns why it was not used, or None."""

    def reject(self, observer: str, reason: str) -> None:
        """Count a message that could not even be read."""

    def set_present(self, observers: frozenset[str]) -> None:
        """Who is alive on the mesh now."""

    def record_clock(self, observer: str, reading: ClockReading) -> None:
        """An observer was asked what time it has."""

    def skew_s(self, observer: str) -> float | None:
        """Seconds by which an observer's clock is ahead of ours; None while it was never asked."""

    def continue_from(self, judgement: JudgementMessage) -> None:
        """Go on where another fusion service was."""

    @property
    def reliability(self) -> Reliability:
        """What was learned of the observers."""

    @reliability.setter
    def reliability(self, reliability: Reliability) -> None:
        """Go on from what was learned before a restart."""

    def step(self, now_ns: int) -> EngineOutputLike | None:
        """What the judges together believe at `now_ns`; None while there is nothing to judge."""
