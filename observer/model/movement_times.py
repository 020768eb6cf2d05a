"""What a model's takes tell about the durations of its movements: shortest take and rest, period. Pure."""

from collections.abc import Sequence
from dataclasses import replace

from common.message_types import MovementTimes
from observer.model.base import Header, StreamSpan
from observer.model.periodicity import Oscillation, oscillation_of, with_other_side
from observer.model.training_memory import TrainingMemory
from observer.model.training_rows import AFTERGLOW_S
from observer.tracks import Floats


def with_times(header: Header, memory: TrainingMemory) -> Header:
    """The header whose vocabulary tells the durations of its movements, as far as the memory shows them."""
    movements = {
        label: _times_of(movement, memory, header.rate_hz) for movement, label in enumerate(header.vocabulary.labels)
    }
    return replace(header, vocabulary=replace(header.vocabulary, movements=movements))


def _times_of(movement: int, memory: TrainingMemory, rate_hz: float) -> MovementTimes:
    takes = memory.lengths_of(movement)
    oscillation = oscillation_of(_takes_of(movement, memory, rate_hz), rate_hz)
    rests = [
        following.begin - span.end
        for stream in memory.streams
        for span, following in zip(stream.spans, stream.spans[1:], strict=False)
        if span.movement == following.movement == movement and not _touch(span, following, rate_hz)
    ]
    # To a millisecond.
    return MovementTimes(
        shortest_s=round(min(takes) / rate_hz, 3) if takes else None,
        rest_s=round(min(rests) / rate_hz, 3) if rests else None,
        period_s=round(oscillation.period_s, 3) if oscillation else None,
    )


def _takes_of(movement: int, memory: TrainingMemory, rate_hz: float) -> list[Floats]:
    """The traces of its takes; of spans that follow each other without rest, the trace from the first to the last."""
    takes, joined = [], set[tuple[str, str]]()
    for stream in memory.streams:
        spans = [span for span in stream.spans if span.movement == movement]
        for run in _runs_of(spans, rate_hz):
            joined |= {(stream.subject, span.trial) for span in run}
            takes.append(stream.features[run[0].begin : run[-1].end])
    alone = (e for e in memory.examples if e.movement == movement and (e.subject, e.trial) not in joined)
    return [*takes, *(e.features for e in alone)]


def _touch(span: StreamSpan, following: StreamSpan, rate_hz: float) -> bool:
    return following.begin - span.end <= AFTERGLOW_S * rate_hz


def _runs_of(spans: Sequence[StreamSpan], rate_hz: float) -> list[list[StreamSpan]]:
    """The runs of two spans and more of which each begins where the one before ends."""
    runs = list[list[StreamSpan]]()
    for span in spans:
        if runs and _touch(runs[-1][-1], span, rate_hz):
            runs[-1].append(span)
        else:
            runs.append([span])
    return [run for run in runs if len(run) > 1]


def oscillations_of(header: Header, memory: TrainingMemory) -> dict[int, Oscillation]:
    """How the movements go to and fro that are periodic by the header, by index in the vocabulary."""
    oscillations = {}
    for movement, label in enumerate(header.vocabulary.labels):
        times = header.vocabulary.movements.get(label)
        if times is not None and times.period_s is not None:
            oscillation = oscillation_of(_takes_of(movement, memory, header.rate_hz), header.rate_hz)
            if oscillation is not None:
                known = replace(oscillation, rest_s=times.rest_s)
                oscillations[movement] = with_other_side(known, header.body_parts)
    return oscillations
