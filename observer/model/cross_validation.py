"""Cross-validation of a kind of model that evaluates whole folds at once: its input and its result. Pure."""

import json
from collections import Counter
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

from common.vocabulary import Vocabulary
from observer.model.base import Arrays, Example, Header, Stream
from observer.tracks import Floats


@dataclass(frozen=True, slots=True)
class CrossValidation:
    """The examples, and how to evaluate them.

    folds: indices of the examples that are left out together; a recording is left out at all its facings. watched: the
    indices of those that are evaluated where that takes long. shares: of a movement, after which it is evaluated; the
    last is 1.0, where it has ended.
    """

    examples: Sequence[Example]
    streams: Sequence[Stream]
    folds: Sequence[Sequence[int]]
    watched: Collection[int]
    shares: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class HeldOutResult:
    """The result for an example by a model that had not learned from its person; posteriors: (T, M) at T times.

    truth: index of the right answer.
    """

    truth: int
    posteriors: Floats


@dataclass(frozen=True, slots=True)
class LearnedFromOthers:
    """The outcome of a cross-validation: the held-out results, and the arrays by name with which they come about.

    strange_named: the share of movements that the model does not know which it would name; None if unknown.
    """

    results: list[HeldOutResult]
    arrays: Arrays = field(default_factory=dict)
    strange_named: float | None = None


def judged_as(results: Sequence[HeldOutResult], vocabulary: Vocabulary) -> dict[str, dict[str, int]]:
    """For each movement, as what its left-out examples were recognised, and how often."""
    table: dict[str, Counter[str]] = {}
    for result in results:
        judged = vocabulary.labels[int(result.posteriors[-1].argmax())]
        table.setdefault(vocabulary.labels[result.truth], Counter())[judged] += 1
    return {label: dict(counts) for label, counts in table.items()}


def held_out_of(header: Header) -> dict[str, dict[str, int]]:
    """By movement as what its examples were recognised by models that had not learned from them; {} if unknown."""
    with suppress(ValueError, AttributeError, TypeError):
        table = json.loads(header.provenance.get("held_out", "{}"))
        return {str(truth): {str(label): int(n) for label, n in row.items()} for truth, row in table.items()}
    return {}
