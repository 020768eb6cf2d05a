"""Judging continuous streams: spotting movements, by MSRC-12's protocol.

A verdict is right when it has the label of a movement and falls within 333 ms of its span, once per movement. Every
other verdict except `abstain` is a false alarm. The score counts the first word of a verdict, because a home acts on
it; the score by the last word, known at the end, is reported beside it. Streams may contain movements that were not
learned: a verdict on one of these is a false alarm too.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common import SECOND_NS
from common.config_sections import FusionConfig, default_quorum
from common.messages import PosteriorMessage
from common.vocabulary import ABSTAIN, Vocabulary
from observer.model.base import MovementModel, Onset
from observer.motion.archive import MotionArchive, Recording, Span
from observer.motion.projected import ProjectedTracker, frames_of
from observer.runtime.pipeline import Observer, PosteriorEncoder
from studies.evaluate import EvaluationSettings, Progress, folds_of, learn
from studies.fusion_engine import FusionEngine, step
from studies.trials import IDLE_NOISE_M

TOLERANCE_S = 0.333
BETWEEN_S = (1.0, 2.5)
THRESHOLDS = (0.6, 0.7, 0.8, 0.9, 0.95)
"""Values of [fusion] threshold to compare when unlearned movements are shown."""


@dataclass(frozen=True, slots=True)
class StreamVerdict:
    """A verdict: its first label, when it was decided (seconds from the stream's start), and its last label."""

    label: str
    at_s: float
    last: str


@dataclass(frozen=True, slots=True)
class SpottingScore:
    """Counts over streams; latencies in seconds from the begin of a movement to its right verdict.

    unlearned: movements that were not learned; labelled: how many of them got a label.
    """

    right: int = 0
    false: int = 0
    movements: int = 0
    rest_s: float = 0.0
    alarms_at_rest: int = 0
    latencies_s: tuple[float, ...] = ()
    unlearned: int = 0
    labelled: int = 0

    def plus(self, other: "SpottingScore") -> "SpottingScore":
        """The sum of both."""
        return SpottingScore(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(SpottingScore)))

    @property
    def f1(self) -> float:
        """2 right / (verdicts + movements)."""
        return 2 * self.right / max(self.right + self.false + self.movements, 1)

    def as_json(self) -> dict[str, float | None]:
        """The contract's `stream`."""
        return {
            "f1": self.f1,
            "precision": self.right / max(self.right + self.false, 1),
            "recall": self.right / max(self.movements, 1),
            "false_alarms_per_minute": self.alarms_at_rest / max(self.rest_s / 60, 1e-9),
            "median_latency_s": float(np.median(self.latencies_s)) if self.latencies_s else None,
            "unlearned": self.unlearned,
            "unlearned_named": self.labelled / self.unlearned if self.unlearned else None,
        }


@dataclass(frozen=True, slots=True)
class StreamScores:
    """The scores by the first and by the last word of every verdict."""

    first: SpottingScore = SpottingScore()
    last: SpottingScore = SpottingScore()

    def plus(self, stream: "ObservedStream", config: FusionConfig, labels: Sequence[str]) -> "StreamScores":
        """The sum with the scores of one more stream, fused by `config`."""
        verdicts = verdicts_in(stream, config)
        by_last = [replace(verdict, label=verdict.last) for verdict in verdicts]
        first, last = (score(words, stream.recording, labels) for words in (verdicts, by_last))
        return StreamScores(self.first.plus(first), self.last.plus(last))

    def as_json(self) -> dict[str, Any]:
        """The contract's `stream` by the first word, and f1, recall, unlearned_named by the last word."""
        last = self.last.as_json()
        names = ("f1", "recall", "unlearned_named")
        return self.first.as_json() | {f"{name}_last_word": last[name] for name in names}


@dataclass(frozen=True, slots=True)
class ObservedStream:
    """A stream, and for each of its frames the message of every observer."""

    recording: Recording
    vocabulary: Vocabulary
    messages: Sequence[Mapping[str, PosteriorMessage]]


def judge_streams(
    archive: MotionArchive, settings: EvaluationSettings, progress: Progress = lambda *_: None
) -> dict[str, Any]:
    """Judge the test people's streams: continuous recordings as they are, else their recordings strung together."""
    quorum = default_quorum(len(settings.views))
    config = FusionConfig(rule=settings.rule, temperature=settings.temperature, quorum=quorum)
    configs = [config, *(config.model_copy(update={"threshold": t}) for t in THRESHOLDS if settings.unlearned)]
    scores = [StreamScores() for _ in configs]
    for stream in observed_streams(archive, settings, progress):
        scores = [s.plus(stream, c, settings.labels) for s, c in zip(scores, configs, strict=True)]
    rows = [{"threshold": c.threshold, **s.as_json()} for c, s in zip(configs[1:], scores[1:], strict=True)]
    return scores[0].as_json() | {"by_threshold": rows}


def observed_streams(
    archive: MotionArchive, settings: EvaluationSettings, progress: Callable[[str, int, int], None] = lambda *_: None
) -> Iterator[ObservedStream]:
    """The observers' messages about each stream; see judge_streams."""
    for number, split in enumerate(folds_of(archive, settings, (*settings.labels, *settings.unlearned))):
        models = learn(split, Vocabulary(settings.labels), settings)
        rng = np.random.default_rng([settings.seed, number, 2])
        people = {r.subject for r in split.test}
        whole = [r for r in archive.recordings if r.spans and r.subject in people]
        streams = whole or strung(split.test, rng)
        for n, stream in enumerate(streams, 1):
            yield _observe(stream, models, archive.body_parts, settings)
            progress("judging streams", n, len(streams))


def strung(recordings: Sequence[Recording], rng: np.random.Generator) -> list[Recording]:
    """One stream per person: the recordings in random order, with rest of 1 to 2.5 s before, between and after."""
    return [
        _string([recordings[i] for i in rng.permutation(len(recordings)) if recordings[i].subject == subject], rng)
        for subject in dict.fromkeys(r.subject for r in recordings)
    ]


def _string(recordings: Sequence[Recording], rng: np.random.Generator) -> Recording:
    """Each recording is shifted so that it begins where the one before left the body."""
    rate, pieces, spans, frames = recordings[0].rate_hz, [], [], 0
    last = recordings[0].positions[0]
    for recording in recordings:
        moved = recording.positions + np.nan_to_num(last[-1] - recording.positions[0, -1])
        idle = _idle(last, moved[0], round(rng.uniform(*BETWEEN_S) * rate), rng)
        pieces += [idle, moved]
        spans.append(Span(frames + len(idle), frames + len(idle) + len(moved), recording.label))
        frames += len(idle) + len(moved)
        last = moved[-1]
    pieces.append(_idle(last, last, round(rng.uniform(*BETWEEN_S) * rate), rng))
    positions = np.concatenate(pieces).astype(np.float32)
    return Recording(positions, rate, "", recordings[0].subject, "strung", tuple(spans))


def _idle(
    before: NDArray[np.float32], after: NDArray[np.float32], frames: int, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Trembling rest, with a slow shift from one resting posture to the next."""
    share = np.clip(np.linspace(-0.5, 1.5, frames), 0, 1)[:, None, None]
    smooth = share * share * (3 - 2 * share)
    still = before * (1 - smooth) + after * smooth
    return (still + rng.normal(0, IDLE_NOISE_M, still.shape)).astype(np.float32)


def _observe(
    stream: Recording, models: Sequence[MovementModel], recorded: tuple[str, ...], settings: EvaluationSettings
) -> ObservedStream:
    observers = {
        f"view-{v}": Observer(ProjectedTracker(view, recorded, model.header.body_parts), model, Onset())
        for v, (view, model) in enumerate(zip(settings.views, models, strict=True))
    }
    vocabulary = models[0].header.vocabulary
    encoders = {name: PosteriorEncoder(vocabulary, "stream") for name in observers}
    messages = [
        {
            name: encoders[name].encode(o.step(frame), frame.captured_ns, frame.captured_ns)
            for name, o in observers.items()
        }
        for frame in frames_of(stream, start_ns=SECOND_NS)
    ]
    return ObservedStream(stream, vocabulary, messages)


def verdicts_in(stream: ObservedStream, config: FusionConfig) -> list[StreamVerdict]:
    """The verdicts of the fusion engine on a stream; its clock is the capture time."""
    engine = FusionEngine("stream", list(stream.messages[0]), stream.vocabulary, config)
    verdicts: dict[str, StreamVerdict] = {}
    for messages in stream.messages:
        now_ns = max(message.captured_ns for message in messages.values())
        for verdict in step(engine, messages, now_ns).verdicts:
            at_s = (verdict.decided_ns - SECOND_NS) / SECOND_NS
            first = verdicts.get(verdict.id, StreamVerdict(verdict.label, at_s, verdict.label))
            verdicts[verdict.id] = replace(first, last=verdict.label)
    return list(verdicts.values())


def score(verdicts: Sequence[StreamVerdict], stream: Recording, labels: Sequence[str]) -> SpottingScore:
    """Compare verdicts with the spans of the stream; spans whose label is not in `labels` must get no verdict."""
    rate, matched, labelled, false, at_rest, latencies = stream.rate_hz, set[int](), set[int](), 0, 0, []
    for verdict in verdicts:
        if verdict.label == ABSTAIN:
            continue
        near = [
            n
            for n, s in enumerate(stream.spans)
            if s.start / rate - TOLERANCE_S <= verdict.at_s <= s.end / rate + TOLERANCE_S
        ]
        hit = next((n for n in near if stream.spans[n].label == verdict.label and n not in matched), None)
        if hit is None:
            false += 1
            at_rest += not near
            labelled |= {n for n in near if stream.spans[n].label not in labels}
        else:
            matched.add(hit)
            latencies.append(verdict.at_s - stream.spans[hit].start / rate)
    moving = sum(s.end - s.start for s in stream.spans)
    rest_s = (len(stream.positions) - moving) / rate
    unlearned = sum(s.label not in labels for s in stream.spans)
    learned = len(stream.spans) - unlearned
    return SpottingScore(len(matched), false, learned, rest_s, at_rest, tuple(latencies), unlearned, len(labelled))
