"""The windows of continuous recordings that the spotter learns from: movements, their first parts, something else."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from observer.motion.archive import Recording, Span
from observer.tracks import Floats

LENGTHS = 5
SHORTEST = 6
"""Frames of the shortest window."""
JITTER = 0.08
JITTERED = 6
"""Windows per span whose ends are moved by JITTER of its length."""
PREFIXES = (0.5, 0.65, 0.8)
"""So that a movement is recognised before it ends."""
ELSEWHERE = 14
"""Windows per span from anywhere else: something else."""
MOST_OVERLAP = 0.25
"""Intersection over union of such a window with a span."""
MOST_INSIDE = 0.5
"""The largest share of such a window that lies in a span."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelledWindow:
    """Frames begin..end-1 of a stream; movement: its index, M for something else."""

    begin: int
    end: int
    movement: int


def window_lengths(streams: Sequence[Recording]) -> Floats:
    """(LENGTHS,) seconds, evenly spaced in their logarithm, around the lengths of the spans."""
    seconds = [(span.end - span.start) / stream.rate_hz for stream in streams for span in stream.spans]
    low, high = np.quantile(seconds, [0.1, 0.9])
    lengths: Floats = np.geomspace(0.5 * low, 1.4 * high, LENGTHS)
    return lengths


def choose_windows(
    stream: Recording, lengths_s: Floats, labels: Sequence[str], rng: np.random.Generator
) -> list[LabelledWindow]:
    """Training windows: every span with both ends moved a little, its first parts, and windows of something else."""
    windows = []
    for span in stream.spans:
        length, movement = span.end - span.start, labels.index(span.label)
        for begin, end in rng.normal(0, JITTER * length, (JITTERED, 2)):
            windows.append(LabelledWindow(int(span.start + begin), int(span.end + end), movement))
        for share in PREFIXES:
            before = 0.1 * length * rng.random()
            windows.append(LabelledWindow(int(span.start - before), int(span.start + share * length), movement))
    frames = len(stream.positions)
    within = [
        LabelledWindow(max(w.begin, 0), min(max(w.end, max(w.begin, 0) + SHORTEST), frames), w.movement)
        for w in windows
    ]
    return [w for w in within if w.end - w.begin >= SHORTEST] + _elsewhere(stream, lengths_s, len(labels), rng)


def _elsewhere(stream: Recording, lengths_s: Floats, movement: int, rng: np.random.Generator) -> list[LabelledWindow]:
    windows: list[LabelledWindow] = []
    wanted, frames = ELSEWHERE * len(stream.spans), len(stream.positions)
    for _ in range(50 * wanted):
        length = max(int(rng.choice(lengths_s) * stream.rate_hz), SHORTEST)
        if len(windows) == wanted or length >= frames:
            continue
        begin = int(rng.integers(frames - length))
        if all(is_elsewhere(begin, begin + length, span) for span in stream.spans):
            windows.append(LabelledWindow(begin, begin + length, movement))
    return windows


def is_elsewhere(begin: int, end: int, span: Span) -> bool:
    """Whether the frames begin..end-1 show too little of the span to be it, or a part of it."""
    common = max(0, min(end, span.end) - max(begin, span.start))
    union = max(end, span.end) - min(begin, span.start)
    return common / union < MOST_OVERLAP and common / (end - begin) < MOST_INSIDE
