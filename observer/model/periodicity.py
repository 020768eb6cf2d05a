"""Whether the takes of a movement are periodic, with which period, and along which axes they go to and fro. Pure.

The period is the lag at which a movement is most like itself: the first of the high peaks of the normalised square
difference function (McLeod and Wyvill, "A smarter way to find pitch", ICMC 2005, sections 4 to 6), here of all parts at
once, and over the part of a take where it is highest (docs/design/model.md).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from observer.body import USUAL_NOISE
from observer.features import REFERENCE_HZ
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
