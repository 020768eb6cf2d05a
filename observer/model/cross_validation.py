"""How a kind of model may evaluate examples of people whom it has not learned from, many at once. Pure."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from observer.model.base import Example, Header, Stream
from observer.model.posterior_calibration import HeldOutResult


@dataclass(frozen=True, slots=True)
class CrossValidation:
    """Which examples are left out together, as indices, and which of them are watched if that takes long.

    A recording is left out at all its facings, and is watched at some of them.
    explicit: the names of parameters that the user has set, which stay as they are. shares: of a movement, after
    which it is evaluated; the last is 1.0, where it has ended.
    """

    examples: Sequence[Example]
    streams: Sequence[Stream]
    folds: Sequence[Sequence[int]]
    watched: Collection[int]
    shares: tuple[float, ...]
    explicit: Collection[str] = ()


@runtime_checkable
class CrossValidates(Protocol):
    """The additional method of a kind of model that evaluates all examples of a fold at once.

    It may also learn parameters that only examples of other people tell.
    """

    def cross_validated(
        self, header: Header, cross_validation: CrossValidation
    ) -> tuple[Mapping[str, float], list[HeldOutResult]]:
        """A classmethod: the parameters learned so, by name, and the results with these."""
