"""How often who was right, and how far chance could have moved that: other people, other trials of theirs. Pure.

Shapes: right (F, N) per fraction and trial, 1 right, 0 wrong, a share where several runs of one classifier differ.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

DRAWS = 2000
COVERAGE = 0.95


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Who judged, and right (F, N): how often he was right about each trial when each fraction was seen."""

    name: str
    right: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Contest:
    """All who judged one set of movements: the same N trials, of people (N names), in every curve."""

    movements: str
    people: tuple[str, ...]
    curves: tuple[Curve, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """mean (F+1,): accuracy at each fraction, and last the area under the curve. low, high (F+1,): where 95 % of the
    bootstrap's draws lie."""

    mean: Floats
    low: Floats
    high: Floats


def scored(rights: Sequence[Floats], people: Sequence[Sequence[str]], seed: int = 0) -> Score:
    """The mean over one or several sets of trials, each (F, N) with the names of the N trials' people.

    Differences of two curves are scored as any curve is. The interval is a bootstrap in two stages: people are drawn
    with replacement, the same ones for every set, then as many trials of each as he has. With few people it is rough.
    """
    known = sorted({person for names in people for person in names})
    rng = np.random.default_rng(seed)
    drawn = rng.multinomial(len(known), np.full(len(known), 1 / len(known)), size=DRAWS)
    sets = [
        _with_area(right @ _weights(names, known, drawn, rng).T) for right, names in zip(rights, people, strict=True)
    ]
    # A set none of whose people was drawn has no accuracy in that draw.
    low, high = np.nanquantile(np.mean(sets, axis=0), [(1 - COVERAGE) / 2, (1 + COVERAGE) / 2], axis=1)
    return Score(np.mean([_with_area(right.mean(axis=1)) for right in rights], axis=0), low, high)


def _weights(names: Sequence[str], known: Sequence[str], drawn: NDArray[np.int64], rng: np.random.Generator) -> Floats:
    """(DRAWS, N) shares of the trials in each draw, NaN where no person of this set was drawn."""
    counts = np.zeros((len(drawn), len(names)))
    for person, times in zip(known, drawn.T, strict=True):
        own = [n for n, name in enumerate(names) if name == person]
        if own:
            counts[:, own] = rng.multinomial(times * len(own), np.full(len(own), 1 / len(own)))
    total = counts.sum(axis=1, keepdims=True)
    shares: Floats = np.where(total > 0, counts / np.maximum(total, 1), np.nan)
    return shares


def _with_area(accuracies: Floats) -> Floats:
    """(F, ...) -> (F+1, ...): the mean over the fractions comes last."""
    return np.concatenate([accuracies, accuracies.mean(axis=0, keepdims=True)])
