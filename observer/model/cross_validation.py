"""The result of a cross-validation of a kind of model that evaluates whole folds at once. Pure."""

import json
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import NamedTuple

from common.vocabulary import Vocabulary
from observer.model.base import Arrays, Header


class HeldOutResult(NamedTuple):
    """As which movement a model recognised an example from whose person it had not learned: indices."""

    truth: int
    judged: int


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
    for truth, judged in results:
        table.setdefault(vocabulary.labels[truth], Counter())[vocabulary.labels[judged]] += 1
    return {label: dict(counts) for label, counts in table.items()}


def held_out_of(header: Header) -> dict[str, dict[str, int]]:
    """By movement as what its examples were recognised by models that had not learned from them; {} if unknown."""
    with suppress(ValueError, AttributeError, TypeError):
        table = json.loads(header.provenance.get("held_out", "{}"))
        return {str(truth): {str(label): int(n) for label, n in row.items()} for truth, row in table.items()}
    return {}
