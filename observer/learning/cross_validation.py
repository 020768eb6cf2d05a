"""Trying a model on who it has not learned from, one person at a time, to know how far it can be believed."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from observer.model.base import Example, Header, MovementModel, Onset, WithBackground, evenly_spread
from observer.model.posterior_calibration import PosteriorCalibration, Tried, answers_of, fit, not_surer

MOST_TRIED = 240
"""Examples that are judged; more hardly change the few numbers that are fitted."""


def certainty_of(kind: type[MovementModel], header: Header, examples: Sequence[Example]) -> PosteriorCalibration:
    """How far a model learned from all these examples can be believed, found by leaving out one person at a time.

    Where a movement was shown by one person alone, one recording of each movement is left out at a time instead. That
    says nothing of other people, and no more is believed of such a model than of one that could hardly be tried.
    """
    return _fitted(header, examples, _tries(kind, header, examples))


def believable(kind: type[MovementModel], model: MovementModel, examples: Sequence[Example]) -> MovementModel:
    """The same model, knowing its certainty; `tried` and `right` of its provenance say what that comes from."""
    tried = _tries(kind, model.header, examples)
    certainty = _fitted(model.header, examples, tried)
    said = {**model.header.provenance, **told(tried)}
    header = replace(model.header, certainty=certainty, provenance=said)
    return kind.from_arrays(header, model.arrays())


def told(tried: Sequence[Tried]) -> dict[str, str]:
    """For the provenance: how many examples were judged by models that had not learned them, and how many right."""
    right = sum(int(t.beliefs[-1].argmax()) == t.truth for t in tried)
    return {"tried": str(len(tried)), "right": str(right)}


def judged(model: MovementModel, example: Example) -> Tried:
    """What a model, which should not have learned it, believes of the example at its end, when verdicts are made."""
    watch = model.watch(Onset(known=True, length=len(example.tracks)))
    for tracks in example.tracks:
        watch.update(tracks)
    movements = model.header.vocabulary.size
    truth = example.movement if example.movement >= 0 else movements
    return Tried(truth, answers_of(watch).sum(axis=1)[None], watch.foreseen)


def by_recording(examples: Sequence[Example]) -> list[list[int]]:
    """Indices of the examples left out together: one of each movement that has several, the first, the second, ..."""
    counts: Counter[int] = Counter()
    by_turn: dict[int, list[int]] = {}
    several = {m for m, count in Counter(e.movement for e in examples).items() if count > 1}
    for n, example in enumerate(examples):
        if example.movement in several:
            by_turn.setdefault(counts[example.movement], []).append(n)
            counts[example.movement] += 1
    return list(by_turn.values())


def by_person(examples: Sequence[Example]) -> list[list[int]] | None:
    """Indices of the examples left out together: one person's; None when a movement would then have no example."""
    learned = [e for e in examples if e.movement >= 0]
    movements = {e.movement for e in learned}
    subjects = sorted({e.subject for e in examples})
    if any({e.movement for e in learned if e.subject != s} != movements for s in subjects):
        return None
    return [[n for n, e in enumerate(examples) if e.subject == s] for s in subjects]


def _tries(kind: type[MovementModel], header: Header, examples: Sequence[Example]) -> list[Tried]:
    # Which way somebody faces hardly changes how sure one may be, and a dozen facings take a dozen times as long.
    front = [e for e in examples if e.facing == 0]
    header = replace(header, parameters=_one_facing(header.parameters))
    folds = by_person(front) or by_recording(front)
    return [t for out in folds for t in _tried(kind, header, front, out)]


def _fitted(header: Header, examples: Sequence[Example], tried: Sequence[Tried]) -> PosteriorCalibration:
    found = fit(tried, header.vocabulary.size)
    return found if by_person(examples) else not_surer(found)


def _one_facing(parameters: Mapping[str, float]) -> dict[str, float]:
    return {name: 1.0 if name == "facings" else value for name, value in parameters.items()}


def _tried(
    kind: type[MovementModel], header: Header, examples: Sequence[Example], out: Sequence[int]
) -> Iterator[Tried]:
    """Judged by a model of all others; of many only some are judged, though all are left out."""
    left, share = set(out), MOST_TRIED / len(examples)
    model = kind.learn(header, [e for n, e in enumerate(examples) if n not in left])
    for n in out:
        # Evenly spread however the examples are ordered: every second one could be always the same movements.
        if evenly_spread(n) < share:
            judge = _without(model, examples[n].movement)
            if judge is not None:
                yield judged(judge, examples[n])


def _without(model: MovementModel, movement: int) -> MovementModel | None:
    """Who can judge an example of that movement: of the background, who has learned from others alone."""
    if movement >= 0:
        return model
    if isinstance(model, WithBackground) and len(model.header.background or ()) > 1:
        return model.without_background(-1 - movement)
    return None
