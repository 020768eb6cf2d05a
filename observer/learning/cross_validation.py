"""Cross-validation of a model by person, to calibrate its posteriors."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from observer.model.base import Example, Header, MovementModel, Onset, WithBackground, evenly_spread
from observer.model.posterior_calibration import (
    HeldOutResult,
    answer_posterior,
    at_least_cautious,
    fit_calibration,
)

MOST_EVALUATED = 240
"""Examples that are evaluated; more hardly change the few numbers that are fitted."""


def with_calibration(kind: type[MovementModel], model: MovementModel, examples: Sequence[Example]) -> MovementModel:
    """The same model with its calibration, estimated by leaving out one person at a time.

    If only one person shows a movement, one recording of each movement is left out at a time instead. That tells
    nothing about other people, and the result is at least as cautious as CAUTIOUS. `tried` and `right` in the
    provenance count the evaluated examples.
    """
    results = _cross_validate(kind, model.header, examples)
    calibration = fit_calibration(results, model.header.vocabulary.size)
    if folds_by_person(examples) is None:
        calibration = at_least_cautious(calibration)
    counts = {"tried": str(len(results)), "right": str(right_count(results))}
    header = replace(model.header, calibration=calibration, provenance={**model.header.provenance, **counts})
    return kind.from_arrays(header, model.arrays())


def right_count(results: Sequence[HeldOutResult]) -> int:
    """How many of the examples were recognised."""
    return sum(int(r.posteriors[-1].argmax()) == r.truth for r in results)


def evaluate_example(model: MovementModel, example: Example) -> HeldOutResult:
    """The model's posterior at the end of an example that it has not learned, where verdicts are made."""
    watch = model.watch(Onset(known=True, length=len(example.tracks)))
    for tracks in example.tracks:
        watch.update(tracks)
    movements = model.header.vocabulary.size
    truth = example.movement if example.movement >= 0 else movements
    return HeldOutResult(truth, answer_posterior(watch).sum(axis=1)[None], watch.foreseen)


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


def _cross_validate(kind: type[MovementModel], header: Header, examples: Sequence[Example]) -> list[HeldOutResult]:
    # The facing hardly changes the calibration, and a dozen facings take a dozen times as long.
    front = [e for e in examples if e.facing == 0]
    header = replace(header, parameters=_one_facing(header.parameters))
    folds = folds_by_person(front) or folds_by_recording(front)
    return [result for fold in folds for result in _evaluate_fold(kind, header, front, fold)]


def _one_facing(parameters: Mapping[str, float]) -> dict[str, float]:
    return {name: 1.0 if name == "facings" else value for name, value in parameters.items()}


def _evaluate_fold(
    kind: type[MovementModel], header: Header, examples: Sequence[Example], fold: Sequence[int]
) -> Iterator[HeldOutResult]:
    """Results by a model of all other examples; with many examples only a share of the fold is evaluated."""
    left_out, share = set(fold), MOST_EVALUATED / len(examples)
    model = kind.learn(header, [e for n, e in enumerate(examples) if n not in left_out])
    for n in fold:
        # Evenly spread whatever the order: every second example could always be of the same movements.
        if evenly_spread(n) < share:
            unaware = _without_movement(model, examples[n].movement)
            if unaware is not None:
                yield evaluate_example(unaware, examples[n])


def _without_movement(model: MovementModel, movement: int) -> MovementModel | None:
    """The model that may evaluate an example: for a background movement, one that has learned from others only."""
    if movement >= 0:
        return model
    if isinstance(model, WithBackground) and len(model.header.background or ()) > 1:
        return model.without_background(-1 - movement)
    return None
