"""What a model makes of people from whom it has not learned: the material from which the stacker learns. Pure.

A model of the other people watches them, exactly as it watches a person later: every second movement between two rests,
its begin unknown; the others from their known begin; and continuous recordings.
"""

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from observer.features import hop_of, tracks_of
from observer.model.base import Example, Onset, Stream
from observer.model.leaning import Judged
from observer.model.stacker import BEGIN_UNKNOWN, Instants, Stacker, StackerPrior, StackerRows, fit, shown_by
from observer.model.training_rows import (
    LEARNED_FRACTIONS,
    RECOGNISABLE,
    REST_S,
    another_take,
    between_rests,
    frames_apart,
    posture_change,
)
from observer.tracks import Floats, Tracks

if TYPE_CHECKING:
    from observer.model.stacked import Stacked

STRANGE_FROM = 0.6
"""Share of a movement from which it also stands for one that the members do not know: struck out of what they say."""


@dataclass(frozen=True, slots=True, eq=False)
class Watched:
    """An instant of a recording that was watched. example: its index, -1 of a stream; progress: share of the movement.

    truth: -1 for something else; over: whether the recording has ended.
    """

    instant: Instants
    example: int
    truth: int
    progress: float
    weight: float


STRANGE_SHARE = 1 / 3
"""Strange movements and other motion, and what is no movement, for each known one: the base rate of something else
where the recordings show no more of it."""
FAINT = 0.2
"""A movement of this share of the usual extent is none: somebody shifts their weight, or a hand trembles."""


WATCHED_S = 300.0
"""At most so much of the streams is watched in each fold."""


def rows_of_fold(
    model: "Stacked",
    examples: Sequence[Example],
    watched: Sequence[int],
    streams: Sequence[Stream],
    watched_s: float = WATCHED_S,
) -> list[Watched]:
    """What the model makes of these examples and streams, from which it has not learned.

    watched: indices of the examples; watched_s: at most so many seconds of streams.
    """
    rows = [row for n in watched for row in _watch_example(model, examples, n)]
    return rows + list(_watch_streams(model, streams, watched_s))


def streams_left_out(
    streams: Sequence[Stream], examples: Sequence[Example], gone: Collection[int], part: tuple[int, int] | None
) -> Iterator[Stream]:
    """The frames that `TrainingTable.learn` leaves out with these examples."""
    for stream, (begin, end) in zip(streams, frames_apart(streams, examples, gone, part), strict=True):
        yield from stream.piece(begin, end)


def _watch_example(model: "Stacked", examples: Sequence[Example], number: int) -> Iterator[Watched]:
    """The instants at LEARNED_FRACTIONS of the movement, and its end; of every second also of what is none
    after it: by turns a change of posture, and the same motion, but faint.

    All instants of a movement of the background, and of what is none, are something else.
    """
    example = examples[number]
    truth, known = max(example.movement, -1), number % 2 == 0
    if known or not len(example.features):
        yield from _watch_tracks(model, example.tracks, 0, number, truth, known)
        return
    both = (examples[n] for n in (number, another_take(examples, number)))
    trace, other = (each.features.astype(np.float32) for each in both)
    rest, rng = round(REST_S * model.header.rate_hz), np.random.default_rng(number)
    if number % 4 == 1:
        none = posture_change(trace[0], other[0], rest // 2)
    else:
        none = trace[:1] + np.float32(FAINT) * (trace - trace[:1])
        none[:, -1] = trace[:, -1]
    for shown, as_what, weight in ((trace, truth, 1.0), (none, -1, STRANGE_SHARE)):
        tracks = tracks_of(between_rests(shown, rest, 0, rng).astype(np.float64))
        for row in _watch_tracks(model, tracks, rest, number, as_what, known):
            yield replace(row, weight=row.weight * weight)


def _watch_tracks(
    model: "Stacked", tracks: Sequence[Tracks], before: int, number: int, truth: int, known: bool
) -> Iterator[Watched]:
    """before: frames of rest before the movement begins."""
    frames = len(tracks) - before
    stops = {before + max(math.ceil(share * frames), 1): share for share in LEARNED_FRACTIONS}
    watch, weight = model.watch(Onset(known)), 1 / (len(LEARNED_FRACTIONS) + 1)
    for frame, one in enumerate(tracks, 1):
        watch.pass_over(one)
        if frame in stops:
            watch.classify()
            if watch.instant is not None:
                yield Watched(watch.instant, number, truth, stops[frame], weight)
    watch.end()
    if watch.instant is not None:
        yield Watched(watch.instant, number, truth, math.inf, weight)


def _watch_streams(model: "Stacked", streams: Sequence[Stream], watched_s: float) -> Iterator[Watched]:
    """Each instant in which the person does not rest.

    It weighs as long as it lasts: of a movement as a share of it, of other motion in seconds.
    """
    left, hop = watched_s * model.header.rate_hz, hop_of(model.header.rate_hz)
    for stream in streams:
        tracks: Sequence[Tracks] = stream.tracks[: max(int(left), 0)]
        left -= len(tracks)
        watch = model.watch(Onset())
        for frame, one in enumerate(tracks):
            watch.update(one)
            if frame % hop or watch.instant is None or watch.rest >= 0.5:
                continue
            span = next((s for s in stream.spans if s.begin <= frame < s.end), None)
            lasts = model.header.rate_hz if span is None else span.end - span.begin
            progress = 0.0 if span is None else (frame + 1 - span.begin) / lasts
            truth = -1 if span is None else max(span.movement, -1)
            yield Watched(watch.instant, -1, truth, progress, hop / lasts)


def stacker_rows(watched: Sequence[Watched], struck: bool = True) -> StackerRows | None:
    """The rows of the stacker; struck: late instants of known movements are also those of movements not known."""
    if not watched:
        return None
    instants = Instants.of([one.instant for one in watched])
    truth = np.array([one.truth for one in watched], np.int64)
    shown = np.array([min(one.progress / RECOGNISABLE, 1.0) for one in watched])
    weights = np.array([one.weight for one in watched])
    # In a stream a begin that seems known may be that of the movement before.
    segment = np.array([one.example >= 0 or bool(one.instant.context[BEGIN_UNKNOWN]) for one in watched])
    known = truth >= 0
    late = known & np.array([one.progress >= STRANGE_FROM for one in watched])
    if struck and late.any() and instants.members.shape[-1] > 2:
        unknown = instants.at(late).without(truth[late])
        instants = Instants(
            *(np.concatenate([getattr(instants, f), getattr(unknown, f)]) for f in Instants.__dataclass_fields__)
        )
        truth = np.concatenate([truth, np.full(int(late.sum()), -1)])
        shown = np.concatenate([shown, np.zeros(int(late.sum()))])
        # As many as are lacking: other motion that was recorded counts first.
        lacking = max(STRANGE_SHARE * weights[known].sum() - weights[~known].sum(), 0.0)
        weights = np.concatenate([weights, weights[late] * (lacking / weights[late].sum())])
        segment = np.concatenate([segment, np.full(int(late.sum()), False)])
    return StackerRows(instants, truth, shown, weights, segment & (truth >= 0))


def held_out_results(
    prior: StackerPrior, task: Floats, watched: Sequence[Watched]
) -> tuple[Stacker, list[Judged], float | None]:
    """The stacker of all folds, what it makes of each ended example, and how often it names strange ones.

    The last is the share of ended movements that get a name although they are struck out of what the members know; None
    if nothing was tried.
    """
    stacker = fit(prior, task, stacker_rows(watched))
    ended = [one for one in watched if one.example >= 0 and one.truth >= 0 and math.isinf(one.progress)]
    if not ended:
        return stacker, [], None
    instants, truth = Instants.of([one.instant for one in ended]), np.array([one.truth for one in ended])
    p, _ = stacker.judge_ended(instants, _courses(stacker, watched)[[one.example for one in ended]])
    results = [*zip(truth.tolist(), p.argmax(axis=1).tolist(), strict=True)]
    if instants.members.shape[-1] < 3:
        return stacker, results, None
    _, something_else = stacker.judge(instants.without(truth))
    return stacker, results, float((something_else < 0.5).mean())


def _courses(stacker: Stacker, watched: Sequence[Watched]) -> Floats:
    """(N, M) by example the course of its movement, as `Stacker.judge_ended` wants it."""
    own = [one for one in watched if one.example >= 0 and one.truth >= 0]
    shown = shown_by(*stacker.judge(Instants.of([one.instant for one in own])))
    courses = np.zeros((max(one.example for one in own) + 1, shown.shape[1]))
    np.add.at(courses, [one.example for one in own], shown)
    return courses
