"""Trying a model on who it has not learned from, one person at a time, to know how far it can be believed."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from observer.model.base import Example, Header, MovementModel, Onset
from observer.model.certainty import Certainty, Tried, fit

FRACTIONS = (1.0,)
"""Of a movement, at which beliefs are looked at: when verdicts are made."""
MOST_TRIED = 120
"""Examples that are judged; more hardly change the few numbers that are fitted."""


def certainty_of(kind: type[MovementModel], header: Header, examples: Sequence[Example]) -> Certainty:
    """How far a model learned from all these examples can be believed, found by leaving out one person at a time.

    Where a movement was shown by one person alone, one recording of each movement is left out at a time instead.
    """
    # Which way somebody faces hardly changes how sure one may be, and a dozen facings take a dozen times as long.
    front = [e for e in examples if e.facing == 0]
    header = replace(header, parameters=_one_facing(header.parameters))
    tried = [t for out in _folds(front, header.vocabulary.size) for t in _tried(kind, header, front, out)]
    return fit(tried, header.vocabulary.size)


def believable(kind: type[MovementModel], model: MovementModel, examples: Sequence[Example]) -> MovementModel:
    """The same model, knowing its certainty."""
    header = replace(model.header, certainty=certainty_of(kind, model.header, examples))
    return kind.from_arrays(header, model.arrays())


def _one_facing(parameters: Mapping[str, float]) -> dict[str, float]:
    return {name: 1.0 if name == "facings" else value for name, value in parameters.items()}


def _folds(examples: Sequence[Example], movements: int) -> list[list[int]]:
    """Indices of the examples that are left out together."""
    everything = set(range(movements))
    subjects = sorted({e.subject for e in examples})
    folds = [[n for n, e in enumerate(examples) if e.subject == s] for s in subjects]
    if all({e.movement for e in examples if e.subject != s} == everything for s in subjects):
        return folds
    counts: Counter[int] = Counter()
    by_turn: dict[int, list[int]] = {}
    several = {m for m, count in Counter(e.movement for e in examples).items() if count > 1}
    for n, example in enumerate(examples):
        if example.movement in several:
            by_turn.setdefault(counts[example.movement], []).append(n)
            counts[example.movement] += 1
    return list(by_turn.values())


def _tried(
    kind: type[MovementModel], header: Header, examples: Sequence[Example], out: Sequence[int]
) -> Iterator[Tried]:
    """Judged by a model of all others; of many only some are judged, though all are left out."""
    left, every = set(out), max(round(len(examples) / MOST_TRIED), 1)
    model = kind.learn(header, [e for n, e in enumerate(examples) if n not in left])
    for n in out:
        if n % every == 0:
            yield _judged(model, examples[n])


def _judged(model: MovementModel, example: Example) -> Tried:
    frames = len(example.tracks)
    wanted = [max(int(np.ceil(f * frames)), 1) - 1 for f in FRACTIONS]
    watch = model.watch(Onset(known=True, length=frames))
    beliefs, foreseen = [], None
    for n, tracks in enumerate(example.tracks):
        watch.update(tracks)
        foreseen = foreseen if watch.foreseen is None else watch.foreseen
        if n in wanted:
            beliefs += [watch.p] * wanted.count(n)
    return Tried(example.movement, np.array(beliefs), foreseen)
