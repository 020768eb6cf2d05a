"""Spotting movements in streams, by MSRC-12's protocol: scores and results. Pure.

A verdict is right when it has the label of a movement and falls within 333 ms of its span, once per movement. Every
other verdict except `abstain` is a false alarm. The score counts the first word of a verdict, because a home acts on
it; the score by the last word, known at the end, is reported beside it. Streams may contain movements that were not
learned: a verdict on one of these is a false alarm too. Other motion is all time outside the spans, and streams that
have none.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from common.vocabulary import ABSTAIN
from observer.motion.archive import Recording

TOLERANCE_S = 0.333


@dataclass(frozen=True, slots=True)
class StreamVerdict:
    """A verdict: its first label, when it was decided, and its last label; times in seconds from the stream's start.

    began_s, ended_s: the movement's begin, and its end if that was published.
    """

    label: str
    at_s: float
    last: str
    began_s: float | None = None
    ended_s: float | None = None


@dataclass(frozen=True, slots=True)
class JudgedStream:
    """A stream and the verdicts on it. answers: the movement that is judged to go on in each frame, "" for none."""

    recording: Recording
    verdicts: Sequence[StreamVerdict]
    answers: Sequence[str] = ()


@dataclass(frozen=True, slots=True)
class SpottingScore:
    """Counts over streams; latencies in seconds from the begin of a movement to its right verdict.

    unlearned: movements that were not learned; labelled: how many of them got a label. rest_s: time of other motion;
    alarms_at_rest: false verdicts in it. length_s: of all; abstentions: verdicts without a label. frames: with an
    answer; frames_right: where it is the movement that goes on, or none does.
    """

    right: int = 0
    false: int = 0
    movements: int = 0
    rest_s: float = 0.0
    alarms_at_rest: int = 0
    latencies_s: tuple[float, ...] = ()
    unlearned: int = 0
    labelled: int = 0
    length_s: float = 0.0
    abstentions: int = 0
    frames: int = 0
    frames_right: int = 0

    def plus(self, other: "SpottingScore") -> "SpottingScore":
        """The sum of both."""
        return SpottingScore(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(SpottingScore)))

    @property
    def f1(self) -> float:
        """2 right / (verdicts + movements)."""
        return 2 * self.right / max(self.right + self.false + self.movements, 1)

    @property
    def alarms_per_minute(self) -> float:
        """False verdicts a minute of other motion."""
        return self.alarms_at_rest / max(self.rest_s / 60, 1e-9)

    @property
    def abstentions_per_minute(self) -> float:
        """Verdicts without a label, a minute of stream."""
        return self.abstentions / max(self.length_s / 60, 1e-9)

    def as_json(self) -> dict[str, float | None]:
        """The contract's `stream`."""
        return {
            "f1": self.f1,
            "precision": self.right / max(self.right + self.false, 1),
            "recall": self.right / max(self.movements, 1),
            "false_alarms_per_minute": self.alarms_per_minute,
            "median_latency_s": float(np.median(self.latencies_s)) if self.latencies_s else None,
            "unlearned": self.unlearned,
            "unlearned_named": self.labelled / self.unlearned if self.unlearned else None,
            "movements": self.movements,
            "minutes": self.length_s / 60,
            "abstentions_per_minute": self.abstentions_per_minute,
            "frames_right": self.frames_right / self.frames if self.frames else None,
        }


LAST_WORD = ("f1", "precision", "recall", "false_alarms_per_minute", "unlearned_named", "abstentions_per_minute")
"""What is reported by the last word too, under these names and `_last_word`."""


@dataclass(frozen=True, slots=True)
class StreamScores:
    """The scores by the first and by the last word of every verdict."""

    first: SpottingScore = SpottingScore()
    last: SpottingScore = SpottingScore()

    @classmethod
    def of(cls, stream: JudgedStream, labels: Sequence[str]) -> "StreamScores":
        """The scores of one stream."""
        by_last = [replace(verdict, label=verdict.last) for verdict in stream.verdicts]
        first, last = (score(words, stream.recording, labels) for words in (stream.verdicts, by_last))
        right = frames_right(stream.answers, stream.recording, labels)
        return cls(replace(first, frames=len(stream.answers), frames_right=right), last)

    def plus(self, other: "StreamScores") -> "StreamScores":
        """The sum of both."""
        return StreamScores(self.first.plus(other.first), self.last.plus(other.last))

    def as_json(self) -> dict[str, Any]:
        """The contract's `stream` by the first word, and LAST_WORD by the last one."""
        last = self.last.as_json()
        return self.first.as_json() | {f"{name}_last_word": last[name] for name in LAST_WORD}

    def as_other_motion(self) -> dict[str, float]:
        """For streams in which no movement happens: verdicts that name one nevertheless, and abstentions."""
        return {
            "minutes": self.first.length_s / 60,
            "named_per_minute": self.first.alarms_per_minute,
            "named_per_minute_last_word": self.last.alarms_per_minute,
            "abstentions_per_minute": self.first.abstentions_per_minute,
            "abstentions_per_minute_last_word": self.last.abstentions_per_minute,
        }


@dataclass(frozen=True, slots=True)
class StreamResult:
    """The judged streams of all folds: of the vocabulary's movements, and of other motion.

    by_threshold: the scores with other values of [fusion] threshold.
    """

    labels: tuple[str, ...]
    streams: tuple[JudgedStream, ...]
    other_motion: tuple[JudgedStream, ...]
    by_threshold: Mapping[float, StreamScores]

    def as_json(self) -> dict[str, Any]:
        """The contract's `stream`, `by_threshold` and `per_person`; `other_motion` where there is such a stream."""
        rows = [{"threshold": threshold, **scores.as_json()} for threshold, scores in self.by_threshold.items()]
        per_person = {name: self._scores(own).as_json() for name, own in by_person(self.streams).items()}
        figures = self._scores(self.streams).as_json() | {"by_threshold": rows, "per_person": per_person}
        if not self.other_motion:
            return figures
        others = {name: self._scores(own).as_other_motion() for name, own in by_person(self.other_motion).items()}
        total = self._scores(self.other_motion).as_other_motion()
        return figures | {"other_motion": total | {"per_person": others}}

    def _scores(self, streams: Sequence[JudgedStream]) -> StreamScores:
        return total_score(StreamScores.of(stream, self.labels) for stream in streams)


def by_person(streams: Sequence[JudgedStream]) -> dict[str, list[JudgedStream]]:
    """The streams of each person, by their names."""
    result: dict[str, list[JudgedStream]] = {}
    for stream in sorted(streams, key=lambda s: (len(s.recording.subject), s.recording.subject)):
        result.setdefault(stream.recording.subject, []).append(stream)
    return result


def total_score(scores: Iterable[StreamScores]) -> StreamScores:
    """The sum of all scores."""
    total = StreamScores()
    for score in scores:
        total = total.plus(score)
    return total


def frames_right(answers: Sequence[str], stream: Recording, labels: Sequence[str]) -> int:
    """The number of frames whose answer is the movement that goes on; "" is right elsewhere."""
    truth = np.full(len(stream.positions), "", np.object_)
    for span in stream.spans:
        truth[span.start : span.end] = span.label if span.label in labels else ""
    return sum(answer == label for answer, label in zip(answers, truth.tolist(), strict=False))


def spans_hit(verdicts: Sequence[StreamVerdict], stream: Recording) -> list[int | None]:
    """For each verdict the span that it is right about, if there is one."""
    hits: list[int | None] = []
    for verdict in verdicts:
        near = (n for n in _near(verdict, stream) if stream.spans[n].label == verdict.label and n not in hits)
        hits.append(next(near, None))
    return hits


def _near(verdict: StreamVerdict, stream: Recording) -> list[int]:
    """The spans within TOLERANCE_S of the verdict."""
    return [
        n
        for n, span in enumerate(stream.spans)
        if span.start / stream.rate_hz - TOLERANCE_S <= verdict.at_s <= span.end / stream.rate_hz + TOLERANCE_S
    ]


def score(verdicts: Sequence[StreamVerdict], stream: Recording, labels: Sequence[str]) -> SpottingScore:
    """Compare verdicts with the spans of the stream; spans whose label is not in `labels` must get no verdict."""
    rate = stream.rate_hz
    words = [verdict for verdict in verdicts if verdict.label != ABSTAIN]
    hits = spans_hit(words, stream)
    false = [verdict for verdict, hit in zip(words, hits, strict=True) if hit is None]
    near = [_near(verdict, stream) for verdict in false]
    labelled = {n for spans in near for n in spans if stream.spans[n].label not in labels}
    begins = [None if hit is None else stream.spans[hit].start / rate for hit in hits]
    moving = sum(s.end - s.start for s in stream.spans)
    unlearned = sum(s.label not in labels for s in stream.spans)
    return SpottingScore(
        right=len(words) - len(false),
        false=len(false),
        movements=len(stream.spans) - unlearned,
        rest_s=(len(stream.positions) - moving) / rate,
        alarms_at_rest=sum(not spans for spans in near),
        latencies_s=tuple(v.at_s - begin for v, begin in zip(words, begins, strict=True) if begin is not None),
        unlearned=unlearned,
        labelled=len(labelled),
        length_s=len(stream.positions) / rate,
        abstentions=len(verdicts) - len(words),
    )
