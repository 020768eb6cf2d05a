"""The results of a cross-validation, as the provenance of a model tells them. Pure."""

import json
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

from observer.model.base import Header

Judged = tuple[int, int]
"""Indices of a movement, and of the one as which a model recognised it that had not learned from its performer."""


def with_results(header: Header, results: Sequence[Judged], strange_named: float | None = None) -> Header:
    """The header that tells how many were tried, how many were right, and as what each movement was recognised.

    strange_named: the share of movements that the model does not know which it would name; None if unknown.
    """
    labels, table = header.vocabulary.labels, dict[str, Counter[str]]()
    for truth, judged in results:
        table.setdefault(labels[truth], Counter())[labels[judged]] += 1
    counts = {} if strange_named is None else {"strange_named": f"{strange_named:.2f}"}
    counts |= {"tried": str(len(results)), "right": str(sum(truth == judged for truth, judged in results))}
    return replace(header, provenance={**header.provenance, **counts, "held_out": json.dumps(table)})


def held_out_of(header: Header) -> dict[str, dict[str, int]]:
    """By movement as what its examples were recognised by models that had not learned from them; {} if unknown."""
    with suppress(ValueError, AttributeError, TypeError):
        table = json.loads(header.provenance.get("held_out", "{}"))
        return {str(truth): {str(label): int(n) for label, n in row.items()} for truth, row in table.items()}
    return {}
