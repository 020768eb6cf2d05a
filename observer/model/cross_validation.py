"""How a kind of model may evaluate examples of people whom it has not learned from, many at once. Pure."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from common.vocabulary import Vocabulary
from observer.model.base import Arrays, Example, Header, Stream
from observer.model.posterior_calibration import HeldOutResult, PosteriorCalibration


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

    @property
    def across_people(self) -> bool:
        """Whether the people of a fold perform no other examples: only then do results tell about other people."""
        subjects = [example.subject for example in self.examples]
        folds = [set(fold) for fold in self.folds]
        return all(
            {subjects[n] for n in fold}.isdisjoint(s for n, s in enumerate(subjects) if n not in fold) for fold in folds
        )


@dataclass(frozen=True, slots=True)
class LearnedFromOthers:
    """What a kind of model learned from people left out: parameters and arrays by name, and the results with these.

    calibration: the one that fits the kind of model anyway; None: it is fitted to the results.
    """

    parameters: Mapping[str, float]
    results: list[HeldOutResult]
    arrays: Arrays = field(default_factory=dict)
    calibration: PosteriorCalibration | None = None


@runtime_checkable
class CrossValidates(Protocol):
    """The additional method of a kind of model that evaluates all examples of a fold at once.

    It may also learn parameters that only examples of other people tell.
    """

    def cross_validated(self, header: Header, cross_validation: CrossValidation) -> LearnedFromOthers:
        """A classmethod: what is learned so."""


def judged_as(results: Sequence[HeldOutResult], vocabulary: Vocabulary) -> dict[str, dict[str, int]]:
    """For each movement, as what its left-out examples were recognised, and how often; "" is something else."""
    table: dict[str, Counter[str]] = {}
    labels = (*vocabulary.labels, "")
    for result in results:
        if result.truth < vocabulary.size:
            judged = labels[min(int(result.posteriors[-1].argmax()), vocabulary.size)]
            table.setdefault(labels[result.truth], Counter())[judged] += 1
    return {label: dict(counts) for label, counts in table.items()}
