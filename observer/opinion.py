"""What an observer believes after a frame, as those see it who say it, show it or count it."""

from collections.abc import Mapping
from typing import Protocol

from observer.tracks import Floats


class OpinionLike(Protocol):
    """What an observer believes after a frame."""

    @property
    def p(self) -> Floats:
        """(M,) posterior over the vocabulary, cumulative since the movement began."""

    @property
    def rest(self) -> float:
        """Probability that the person is at rest."""

    @property
    def unlearned(self) -> float | None:
        """Probability that what is done is none of the vocabulary's movements; None where that cannot be told."""

    @property
    def frames(self) -> int:
        """How many frames are in it."""

    @property
    def visible(self) -> Mapping[str, bool]:
        """Per body part, whether it was seen in the newest frame."""

    @property
    def facing(self) -> Floats | None:
        """(M, K) P(facing | movement); None of a model that knows one facing alone."""

    @property
    def facets(self) -> Mapping[str, Floats]:
        """How the movement is done, as common.facets names it; those that can be said."""
