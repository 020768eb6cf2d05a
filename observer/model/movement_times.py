"""What a model's takes tell about the durations of its movements: shortest take and rest, period. Pure."""

from collections.abc import Mapping
from dataclasses import replace

from common.message_types import MovementTimes
from observer.model.base import Header, MovementModel
from observer.model.periodicity import Oscillation, oscillation_of
from observer.model.training_memory import Remembers, TrainingMemory, trace_in
from observer.tracks import Floats

DIGITS = 3
"""Durations are known to a millisecond."""


def with_times(header: Header, memory: TrainingMemory) -> Header:
    """The header whose vocabulary tells the durations of its movements, as far as the memory shows them."""
    movements = {
        label: _times_of(movement, memory, header.rate_hz) for movement, label in enumerate(header.vocabulary.labels)
    }
    return replace(header, vocabulary=replace(header.vocabulary, movements=movements))


def _times_of(movement: int, memory: TrainingMemory, rate_hz: float) -> MovementTimes:
    takes = _takes_of(movement, memory)
    oscillation = oscillation_of(takes, rate_hz)
    # Of movements that touch each other, rest is not known.
    rests = [
        following.begin - span.end
        for stream in memory.streams
        for span, following in zip(stream.spans, stream.spans[1:], strict=False)
        if span.movement == following.movement == movement and span.end < following.begin
    ]
    return MovementTimes(
        shortest_s=round(min(map(len, takes)) / rate_hz, DIGITS) if takes else None,
        rest_s=round(min(rests) / rate_hz, DIGITS) if rests else None,
        period_s=_period_s(oscillation),
    )


def _takes_of(movement: int, memory: TrainingMemory) -> list[Floats]:
    return [trace_in(example) for example in memory.examples if example.movement == movement]


def without_times(header: Header) -> Header:
    """The header of a model that need not count repetitions."""
    return replace(header, vocabulary=replace(header.vocabulary, movements={}))


def with_repeats(model: MovementModel, repeats: Mapping[str, bool]) -> MovementModel:
    """The model in which these movements are repeated, or are not, whatever their takes are like.

    A model that does not remember its takes is left as it is.
    """
    header, changed = model.header, dict[str, MovementTimes]()
    for label, times in header.vocabulary.movements.items():
        is_repeated = repeats.get(label, times.period_s is not None)
        if is_repeated != (times.period_s is not None) and isinstance(model, Remembers):
            takes = _takes_of(header.vocabulary.index(label), model.memory)
            oscillation = oscillation_of(takes, header.rate_hz, repeated=True) if is_repeated else None
            changed[label] = times.model_copy(update={"period_s": _period_s(oscillation)})
    if not changed:
        return model
    movements = {**header.vocabulary.movements, **changed}
    header = replace(header, vocabulary=replace(header.vocabulary, movements=movements))
    return type(model).from_arrays(header, model.arrays())


def _period_s(oscillation: Oscillation | None) -> float | None:
    return None if oscillation is None else round(oscillation.period_s, DIGITS)


def oscillations_of(header: Header, memory: TrainingMemory) -> dict[int, Oscillation]:
    """How the movements go to and fro that are periodic by the header, by index in the vocabulary."""
    oscillations = {}
    for movement, label in enumerate(header.vocabulary.labels):
        times = header.vocabulary.movements.get(label)
        if times is not None and times.period_s is not None:
            oscillation = oscillation_of(_takes_of(movement, memory), header.rate_hz, repeated=True)
            if oscillation is not None:
                oscillations[movement] = replace(oscillation, rest_s=times.rest_s)
    return oscillations
