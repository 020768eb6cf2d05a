"""Which windows of the training people's motion the regressions learn from, and what each shows. Pure.

Each example is shown between two rests: a person who stands as at its beginning, does it, and stands as at its end.
Rests, changes of posture, the first part of a movement, means of two movements, and what people do between the
movements of a continuous recording are "something else".
"""

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.body import USUAL_NOISE
from observer.features import hop_of, resampled
from observer.model.base import Example, Shown, Stream, evenly_spread, recording_numbers
from observer.tracks import Floats32, Integers

RECOGNISABLE = 0.35
"""Share of a movement after which its rows show it fully; up to there they show something else in part."""
LEARNED_FRACTIONS = tuple(n / 10 for n in range(1, 11))
"""Shares of a movement after which it is shown."""
REST_S = 1.6
"""How long a person is shown at rest before or after a movement."""
RESTS_AFTER_S = (0.5, 0.9, 1.4)
"""How long after the end of a movement such a rest is shown."""
AFTERGLOW_S = 0.1
"""For so long after its end a movement in a stream is still shown: where it ends is not known better, and spans so near
to each other have no rest between them."""
LEARNED_FACINGS = 4
"""More facings of one example add little to those of the others, and take time."""
BLEND_FRACTIONS = tuple(n / 4 for n in range(2, 5))
"""Shares of a blend after which it is shown: before its half it hardly differs from one of the two movements."""


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Frames `at` (A,) of a trace (F, 2 P + 3), and targets (A, M + 1) with something else last.

    examples: indices of the examples that the trace was made of, the one that it shows first; empty for a stream.
    """

    trace: Floats32
    at: Integers
    targets: Floats32
    examples: tuple[int, ...] = ()


def thin_facings(shown: Sequence[Shown], facings: int) -> list[Shown]:
    """Each example or stream at no more than LEARNED_FACINGS of its facings, and at each facing as many of them."""
    return [shown[n] for n in learned_facings(shown, facings)]


def learned_facings(shown: Sequence[Shown], facings: int) -> list[int]:
    """The indices of what `thin_facings` keeps."""
    step = math.ceil(facings / LEARNED_FACINGS)
    numbers = recording_numbers(shown)
    return [
        n for n, (each, number) in enumerate(zip(shown, numbers, strict=True)) if (number + each.facing) % step == 0
    ]


def rows_of_examples(
    examples: Sequence[Example], traces: Sequence[Floats32], movements: int, rate_hz: float, seed: int = 0
) -> Iterator[Rows]:
    """Each example between rests, and its blend with one of another movement.

    In every second rest the person changes posture.
    """
    rng = np.random.default_rng(seed)
    rest = round(REST_S * rate_hz)
    for n, (example, trace) in enumerate(zip(examples, traces, strict=True)):
        before = rest if n % 2 else 0
        later = traces[another_take(examples, n)][0] if n % 2 else None
        shown = between_rests(trace, before, rest, rng, later)
        fractions = np.array([0.0, *LEARNED_FRACTIONS])
        at = before + np.maximum(np.ceil(fractions * len(trace)).astype(np.int64), 1) - 1
        targets = targets_of(example.movement, np.clip(fractions / RECOGNISABLE, 0, 1), movements)
        after = before + len(trace) + np.array([round(s * rate_hz) for s in RESTS_AFTER_S], np.int64) - 1
        rests = targets_of(-1, np.zeros(len(after)), movements)
        yield Rows(shown, np.concatenate([at, after]), np.concatenate([targets, rests]), (n,))
        other = _other_movement(examples, n)
        if other is not None:
            blend = (trace + resampled(traces[other], len(trace))) / np.float32(2)
            at = np.array([max(round(f * len(blend)), 1) - 1 for f in BLEND_FRACTIONS])
            yield Rows(blend, at, targets_of(-1, np.zeros(len(at)), movements), (n, other))


def rows_of_streams(
    streams: Sequence[Stream], traces: Sequence[Floats32], movements: int, rate_hz: float
) -> Iterator[Rows]:
    """All frames of continuous recordings, thinned as an observer judges them."""
    hop = hop_of(rate_hz)
    for stream, trace in zip(streams, traces, strict=True):
        at = np.arange(0, len(trace), hop)
        targets = targets_of(-1, np.zeros(len(at)), movements)
        for span in stream.spans:
            inside = (at >= span.begin) & (at < span.end + AFTERGLOW_S * rate_hz)
            progress = (at[inside] - span.begin) / (span.end - span.begin)
            targets[inside] = targets_of(span.movement, np.clip(progress / RECOGNISABLE, 0, 1), movements)
        yield Rows(trace, at, targets)


def frames_apart(
    streams: Sequence[Stream], examples: Sequence[Example], gone: Collection[int], part: tuple[int, int] | None
) -> Iterator[tuple[int, int]]:
    """Begin and end of the frames of each stream that are left out together with the examples `gone`.

    All of a person whose examples are all gone; otherwise of streams without movements, and of people who show no
    example, a part: (number, of all), None: nothing.
    """
    left = {e.subject for n, e in enumerate(examples) if n not in gone}
    people = {examples[n].subject for n in gone} - left
    number, parts = part or (0, 1)
    for stream in streams:
        if stream.subject in people:
            yield 0, stream.frames
        elif part is not None and (stream.subject not in left or not stream.spans):
            yield stream.frames * number // parts, stream.frames * (number + 1) // parts
        else:
            yield 0, 0


def targets_of(movement: int, shown: NDArray[np.floating], movements: int) -> Floats32:
    """(A,) how far each row shows the movement -> (A, M + 1); a negative movement is something else."""
    targets = np.zeros((len(shown), movements + 1), np.float32)
    targets[:, -1] = 1.0
    if movement >= 0:
        targets[:, movement] = shown
        targets[:, -1] = 1.0 - shown
    return targets


def between_rests(
    trace: Floats32, before: int, after: int, rng: np.random.Generator, later: Floats32 | None = None
) -> Floats32:
    """The trace after `before` and before `after` frames of trembling rest.

    later: (2 P + 3,) a row whose posture the person takes in the first half of the rest after it.
    """
    rest = np.repeat(trace[-1:], after, axis=0)
    if later is not None:
        rest[: after // 2] = posture_change(trace[-1], later, after // 2)
        rest[after // 2 :, :-3] = later[:-3]
    shown = np.concatenate([np.repeat(trace[:1], before, axis=0), trace, rest])
    noise = rng.normal(0, USUAL_NOISE, shown.shape).astype(np.float32)
    noise[before : before + len(trace)] = 0.0
    noise[:, -1] = 0.0
    result: Floats32 = shown + noise
    return result


def posture_change(begin: Floats32, end: Floats32, frames: int) -> Floats32:
    """(2 P + 3,) rows of two traces -> (frames, 2 P + 3) from the posture of the one to that of the other, in place."""
    share = np.linspace(0, 1, frames, dtype=np.float32)[:, None]
    smooth = share * share * (3 - 2 * share)
    rows = np.repeat(begin[None], frames, axis=0)
    rows[:, :-3] += smooth * (end[:-3] - begin[:-3])
    return rows


def another_take(examples: Sequence[Example], n: int) -> int:
    """The index of the last take before example n, in turn, of the same person and facing; n itself without any."""
    own = (examples[n].subject, examples[n].facing)
    before = ((n - k) % len(examples) for k in range(1, len(examples) + 1))
    return next(k for k in before if (examples[k].subject, examples[k].facing) == own)


def _other_movement(examples: Sequence[Example], n: int) -> int | None:
    others = [
        k for k, e in enumerate(examples) if e.movement != examples[n].movement and e.facing == examples[n].facing
    ]
    return others[int(evenly_spread(n) * len(others))] if others else None
