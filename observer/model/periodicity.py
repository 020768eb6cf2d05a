"""What takes tell about a movement: how long they and their rests are, and whether they go to and fro, and how. Pure.

The period is the lag at which a movement is most like itself: the first of the high peaks of the normalised square
difference function (McLeod and Wyvill, "A smarter way to find pitch", ICMC 2005, sections 4 to 6), here of all parts at
once, and over the part of a take where it is highest (docs/design/model.md).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from common.message_types import MovementTimes
from observer.body import USUAL_NOISE
from observer.features import REFERENCE_HZ
from observer.model.base import Header, StreamSpan
from observer.model.training_memory import TrainingMemory
from observer.model.training_rows import AFTERGLOW_S
from observer.tracks import Floats, other_side

SHORTEST_PERIOD_S = 0.25
"""What goes to and fro faster is the noise of a tracker: waving hands were never faster in kinder_gator."""
COMPARED_PERIODS = 2
"""A take is compared with itself over so many periods, so that it holds one more. A stroke, its return and a second
stroke are not periodic yet."""
LEAST_CORRELATION = 0.6
"""Of a periodic take. In kinder_gator, karate and MSR Action3D single strokes have .0 to .5, repetitions .6 to 1."""
HELD_POSE_SIZES = 2 * USUAL_NOISE
"""Body sizes, root mean square of all parts together: people who hold a pose have once to twice the usual noise."""
NEARLY_HIGHEST = 0.9
"""The first peak that is nearly the highest tells the period: those after it tell its multiples."""
PRINCIPAL_AXES = 2
"""Principal directions of a movement: people repeat it with the one hand or with the other."""


@dataclass(frozen=True, slots=True)
class Period:
    """How a take repeats itself: lag in frames, correlation 0 to 1, and frames begin..end-1 that show it."""

    lag: int
    correlation: float
    begin: int
    end: int


def without_drift(postures: Floats, lag: int) -> Floats:
    """Postures (F, D) less their means over `lag` frames around each, fewer at both ends."""
    sums = np.concatenate([np.zeros((1, postures.shape[1])), postures.cumsum(axis=0)])
    frames = np.arange(len(postures))
    # The same number of frames before and after: otherwise a part of the speed would be left.
    first, last = np.maximum(frames - lag // 2, 0), np.minimum(frames + lag // 2 + 1, len(postures))
    drift = (sums[last] - sums[first]) / (last - first)[:, None]
    result: Floats = postures - drift
    return result


def period_in(postures: Floats, rate_hz: float) -> Period | None:
    """How the postures (F, D) of one take repeat themselves; None if they do not, or too little to tell."""
    at_lag = [_at_lag(postures, lag) for lag in range(2, len(postures) // (COMPARED_PERIODS + 1) + 1)]
    heights = np.array([-1.0, *(period.correlation for period in at_lag), -1.0])
    is_peak = (heights[1:-1] >= heights[:-2]) & (heights[1:-1] > heights[2:])
    peaks = [n for n in np.flatnonzero(is_peak) if at_lag[n].lag >= SHORTEST_PERIOD_S * rate_hz]
    highest = max((heights[n + 1] for n in peaks), default=0.0)
    if highest < LEAST_CORRELATION:
        return None
    return at_lag[next(n for n in peaks if heights[n + 1] >= NEARLY_HIGHEST * highest)]


def _at_lag(postures: Floats, lag: int) -> Period:
    """The part of COMPARED_PERIODS that is most like what follows it a lag later.

    r = 2 sum x(t) x(t + lag) / sum (x(t)^2 + x(t + lag)^2), of postures x without drift. The noise of a pause is not
    compared: the sum below is at least half of what it is in the whole take on average.
    """
    x = without_drift(postures, lag)
    products, squares = 2 * np.einsum("fd,fd->f", x[:-lag], x[lag:]), np.einsum("fd,fd->f", x, x)
    squares = squares[:-lag] + squares[lag:]
    compared = COMPARED_PERIODS * lag
    alike, energy = _sums_over(products, compared), _sums_over(squares, compared)
    least = compared * max(float(squares.mean()) / 2, 2 * HELD_POSE_SIZES**2)
    r = alike / np.maximum(energy, least)
    begin = int(r.argmax())
    return Period(lag, float(r[begin]), begin, begin + compared + lag)


def _sums_over(values: Floats, count: int) -> Floats:
    sums = np.concatenate([[0.0], values.cumsum()])
    result: Floats = sums[count:] - sums[:-count]
    return result


@dataclass(frozen=True, slots=True)
class Oscillation:
    """How a periodic movement goes to and fro.

    axes: (A, 2 P) unit vectors, the strongest first, from where takes begin and end to the far side. swings: (A,) body
    sizes from one turning point to the next along each; swing: along the strongest of each take. rest_s: the shortest
    rest between two takes, None: not known.
    """

    period_s: float
    axes: Floats
    swings: Floats
    swing: float
    rest_s: float | None = None


def oscillation_of(takes: Sequence[Floats], rate_hz: float) -> Oscillation | None:
    """The oscillation that more than half of the takes, traces (F, 2 P + 3), agree on; None if they do not."""
    # Traces at 30 Hz or more are thinned out: no part of a body goes to and fro five times a second.
    step = max(int(rate_hz / REFERENCE_HZ), 1)
    postures, thinned_hz = [_postures_of(trace, step) for trace in takes], rate_hz / step
    periods = [period_in(each, thinned_hz) for each in postures]
    shown = [(each, period) for each, period in zip(postures, periods, strict=True) if period is not None]
    if 2 * len(shown) <= len(takes):
        return None
    cycles = [without_drift(each, period.lag)[period.begin : period.end] for each, period in shown]
    directions = sum(_directions(each, period.lag) for each, (_, period) in zip(cycles, shown, strict=True))
    axes = np.linalg.eigh(directions)[1].T[::-1][:PRINCIPAL_AXES]
    axes = axes * _sense([each @ axes.T for each in postures])[:, None]
    # Of a sine.
    swings = np.array([(each @ axes.T).std(axis=0) * 2 * math.sqrt(2) for each in cycles])
    period_s = float(np.median([period.lag for _, period in shown])) / thinned_hz
    return Oscillation(period_s, axes, _usual(swings), float(np.median(swings.max(axis=1))))


def _postures_of(trace: Floats, step: int) -> Floats:
    """(F, 2 P + 3) -> (F // step, 2 P) places relative to the body, but for its path up and down; means of frames."""
    frames = len(trace) // step
    places = np.array(trace[: frames * step, :-3], np.float64)
    places[:, 1::2] += trace[: frames * step, -2:-1]
    means: Floats = places.reshape(frames, step, places.shape[1]).mean(axis=1)
    return means


def _usual(swings: Floats) -> Floats:
    """(A,) the median swing along each axis of the takes, (N, A), that go farthest along it; of all, if none do."""
    farthest = swings.argmax(axis=1)
    own = [swings[farthest == axis, axis] for axis in range(swings.shape[1])]
    return np.array([np.median(each if len(each) else swings[:, axis]) for axis, each in enumerate(own)])


def _sense(places: Sequence[Floats]) -> Floats:
    """(A,) 1, or -1 where takes begin and end at the far side of an axis. places: of each take, (F, A)."""
    beyond = np.zeros(places[0].shape[1])
    for each in places:
        low, high = each.min(axis=0), each.max(axis=0)
        beyond += ((low + high) - (each[0] + each[-1])) / np.maximum(high - low, HELD_POSE_SIZES)
    return np.where(beyond < 0, -1.0, 1.0)


def _directions(cycles: Floats, lag: int) -> Floats:
    """(D, D) second moment of the directions in which postures (F, D) go to and fro once a period; its trace is 1."""
    wave = np.exp(-2j * np.pi * np.arange(len(cycles)) / lag) @ cycles
    return np.outer(wave, wave.conj()).real / (float((np.abs(wave) ** 2).sum()) or 1.0)


def with_other_side(oscillation: Oscillation, body_parts: Sequence[str]) -> Oscillation:
    """The oscillation with axes for the same movement by the other arm or leg: people choose the side.

    Left and right parts change places. Seen from the front they also go the other way, from the side they do not, and
    oblique views are in between: both are added.
    """
    swapped = oscillation.axes.reshape(len(oscillation.axes), -1, 2)[:, other_side(body_parts)]
    sides = [(swapped * (sign, 1.0)).reshape(oscillation.axes.shape) for sign in (1.0, -1.0)]
    return replace(oscillation, axes=np.concatenate([oscillation.axes, *sides]), swings=np.tile(oscillation.swings, 3))


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
