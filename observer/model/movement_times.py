"""What a model's takes tell about the durations of its movements: shortest take and rest, period. Pure."""

from dataclasses import replace

from common.message_types import MovementTimes
from observer.model.base import Header
from observer.model.periodicity import Oscillation, oscillation_of
from observer.model.training_memory import TrainingMemory, trace_in
from observer.tracks import Floats

DIGITS = 3
"""Durations are told to a millisecond."""


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
        period_s=None if oscillation is None else round(oscillation.period_s, DIGITS),
    )


def _takes_of(movement: int, memory: TrainingMemory) -> list[Floats]:
    return [trace_in(example) for example in memory.examples if example.movement == movement]


def without_times(header: Header) -> Header:
    """The header of a model that need not count repetitions."""
    return replace(header, vocabulary=replace(header.vocabulary, movements={}))


def oscillations_of(header: Header, memory: TrainingMemory) -> dict[int, Oscillation]:
    """How the movements go to and fro that are periodic by the header, by index in the vocabulary."""
    found = {}
    for movement, label in enumerate(header.vocabulary.labels):
        times = header.vocabulary.movements.get(label)
        if times is not None and times.period_s is not None:
            oscillation = oscillation_of(_takes_of(movement, memory), header.rate_hz)
            if oscillation is not None:
                found[movement] = replace(oscillation, rest_s=times.rest_s)
    return found
