"""Folds of the cross-validation: which examples are left out together. Pure."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from observer.model.base import Example, recording_numbers
from observer.motion.archive import MotionArchive

FEWEST_FOLDS = 3
"""Of a kind of model that evaluates a whole fold at once, if there are so many people, or takes of each movement."""
LEARNED_AGAIN = 240
"""Examples that the models of all folds learn from together, about. Few take little time, and a model of two thirds of
five takes is worse than the one that is used."""


def folds_by_recording(examples: Sequence[Example]) -> list[list[int]]:
    """Indices of the examples left out together: the first of each movement that has several, the second, ..."""
    counts: Counter[int] = Counter()
    folds: dict[int, list[int]] = {}
    several = {m for m, count in Counter(e.movement for e in examples).items() if count > 1}
    for n, example in enumerate(examples):
        if example.movement in several:
            folds.setdefault(counts[example.movement], []).append(n)
            counts[example.movement] += 1
    return list(folds.values())


def folds_by_person(examples: Sequence[Example]) -> list[list[int]] | None:
    """Indices of the examples left out together: one person's; None if a movement would then have no example."""
    of_vocabulary = [e for e in examples if e.movement >= 0]
    movements = {e.movement for e in of_vocabulary}
    subjects = sorted({e.subject for e in examples})
    if any({e.movement for e in of_vocabulary if e.subject != s} != movements for s in subjects):
        return None
    return [[n for n, e in enumerate(examples) if e.subject == s] for s in subjects]


def at_all_facings(examples: Sequence[Example], folds: Sequence[Sequence[int]]) -> list[list[int]]:
    """Folds of recordings, as numbers -> of examples, as indices."""
    numbers = recording_numbers(examples)
    return [[n for n, number in enumerate(numbers) if number in recordings] for recordings in map(set, folds)]


def fewer_folds(examples: Sequence[Example], folds: list[list[int]]) -> list[list[int]]:
    """Folds merged into at least FEWEST_FOLDS: with more examples fewer, so that learning all of them takes no longer.

    Unchanged if a movement would have no example outside a merged fold.
    """
    most = max(FEWEST_FOLDS, LEARNED_AGAIN // len(examples))
    merged = [[n for fold in folds[k::most] for n in fold] for k in range(min(most, len(folds)))]
    movements = {e.movement for e in examples if e.movement >= 0}
    for fold in map(set, merged):
        if {e.movement for n, e in enumerate(examples) if n not in fold and e.movement >= 0} != movements:
            return folds
    return merged


def of_one_person(archive: MotionArchive) -> MotionArchive:
    """The same recordings with one subject, so that recordings are left out and not people."""
    return replace(archive, recordings=tuple(replace(r, subject="somebody") for r in archive.recordings))
