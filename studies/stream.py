"""Judging without end: spotting movements in a continuous stream (MSRC-12's protocol).

A verdict is right when it names the movement and falls within 333 ms of its span, once a movement; every other
verdict is a false alarm, abstentions aside. What is scored is the first word of a verdict, not its correction: a home
acts on it; how it is when only the last word counts, which comes at the end, is told beside it. Movements that were not
learned may be strung in between: each that is given a name is a false alarm too.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.config_sections import FusionConfig, default_quorum
from common.messages import PosteriorMessage
from common.vocabulary import ABSTAIN, Vocabulary
from fusion.engine.engine import FusionEngine
from observer.model.base import MovementModel, Onset
from observer.motion.archive import MotionArchive, Recording, Span
from observer.motion.projected import ProjectedTracker, frames_of
from observer.runtime.pipeline import Observer
from observer.runtime.posterior_encoder import PosteriorEncoder
from studies.evaluate import Question, folds_of, learn
from studies.trials import IDLE_NOISE_M

TOLERANCE_S = 0.333
BETWEEN_S = (1.0, 2.5)
THRESHOLDS = (0.6, 0.7, 0.8, 0.9, 0.95)
"""Of the referee: what each keeps of the learned movements, and names of the others."""
SECOND_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Alarm:
    """The first word of a verdict, and when it was said, in seconds from the stream's start; and its last word."""

    label: str
    at_s: float
    last: str


@dataclass(frozen=True, slots=True)
class Score:
    """Counts over streams; latencies in seconds from the begin of a movement to its right verdict.

    unlearned, named: movements that were not learned, and how many of them were given a name.
    """

    right: int = 0
    false: int = 0
    movements: int = 0
    rest_s: float = 0.0
    alarms_at_rest: int = 0
    latencies_s: tuple[float, ...] = ()
    unlearned: int = 0
    named: int = 0

    def plus(self, other: "Score") -> "Score":
        """Both together."""
        return Score(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(Score)))

    @property
    def f1(self) -> float:
        """2 right / (said + movements)."""
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
            "unlearned_named": self.named / self.unlearned if self.unlearned else None,
        }


def judge_stream(
    archive: MotionArchive, question: Question, progress: Callable[[str, int, int], None] = lambda *_: None
) -> dict[str, Any]:
    """Judge the test people's streams: continuous recordings as they are, else their recordings strung together."""
    quorum = default_quorum(len(question.views))
    conduct = FusionConfig(rule=question.rule, temperature=question.temperature, quorum=quorum)
    tried = [conduct.model_copy(update={"threshold": t}) for t in THRESHOLDS if question.unlearned]
    words = [Words() for _ in (conduct, *tried)]
    for heard in heard_in(archive, question, progress):
        words = [w.and_of(heard, c, question.labels) for w, c in zip(words, (conduct, *tried), strict=True)]
    rows = [{"threshold": c.threshold, **w.as_json()} for c, w in zip(tried, words[1:], strict=True)]
    return words[0].as_json() | {"by_threshold": rows}


@dataclass(frozen=True, slots=True)
class Words:
    """The scores of the first word of every verdict, and of the last."""

    first: Score = Score()
    last: Score = Score()

    def and_of(self, heard: "Heard", conduct: FusionConfig, labels: Sequence[str]) -> "Words":
        """And those of what the referee says by this conduct on one stream more."""
        alarms = alarms_in(heard, conduct)
        last = [replace(alarm, label=alarm.last) for alarm in alarms]
        return Words(
            self.first.plus(scored(alarms, heard.stream, labels)), self.last.plus(scored(last, heard.stream, labels))
        )

    def as_json(self) -> dict[str, Any]:
        """The contract's `stream`, of the first word; and what of it is another of the last."""
        last = self.last.as_json()
        names = ("f1", "recall", "unlearned_named")
        return self.first.as_json() | {f"{name}_last_word": last[name] for name in names}


def heard_in(
    archive: MotionArchive, question: Question, progress: Callable[[str, int, int], None] = lambda *_: None
) -> Iterator["Heard"]:
    """What the observers say in each of the streams; see judge_stream."""
    for number, split in enumerate(folds_of(archive, question, (*question.labels, *question.unlearned))):
        models = learn(split, Vocabulary(question.labels), question)
        rng = np.random.default_rng([question.seed, number, 2])
        people = {r.subject for r in split.test}
        whole = [r for r in archive.recordings if r.spans and r.subject in people]
        streams = whole or strung(split.test, rng)
        for n, stream in enumerate(streams):
            yield _heard(stream, models, archive.body_parts, question)
            progress("judging streams", n + 1, len(streams))


def strung(recordings: Sequence[Recording], rng: np.random.Generator) -> list[Recording]:
    """One stream a person: the recordings in random order, idle for 1 to 2.5 s before, between and after."""
    return [
        _string([recordings[i] for i in rng.permutation(len(recordings)) if recordings[i].subject == subject], rng)
        for subject in dict.fromkeys(r.subject for r in recordings)
    ]


def _string(recordings: Sequence[Recording], rng: np.random.Generator) -> Recording:
    """The person stays where he stands: each recording is moved to where the one before left his body."""
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
    """Held still, trembling, and shifted slowly from one resting posture into the next."""
    share = np.clip(np.linspace(-0.5, 1.5, frames), 0, 1)[:, None, None]
    smooth = share * share * (3 - 2 * share)
    still = before * (1 - smooth) + after * smooth
    return (still + rng.normal(0, IDLE_NOISE_M, still.shape)).astype(np.float32)


@dataclass(frozen=True, slots=True)
class Heard:
    """A stream, and what every observer says of each of its frames."""

    stream: Recording
    vocabulary: Vocabulary
    said: Sequence[Mapping[str, PosteriorMessage]]


def _heard(stream: Recording, models: Sequence[MovementModel], recorded: tuple[str, ...], question: Question) -> Heard:
    observers = {
        f"view-{v}": Observer(ProjectedTracker(view, recorded, model.header.body_parts), model, Onset())
        for v, (view, model) in enumerate(zip(question.views, models, strict=True))
    }
    vocabulary = models[0].header.vocabulary
    minutes = {name: PosteriorEncoder(vocabulary, "stream") for name in observers}
    said = [
        {
            name: minutes[name].encode(o.step(frame), frame.captured_ns, frame.captured_ns)
            for name, o in observers.items()
        }
        for frame in frames_of(stream, start_ns=SECOND_NS)
    ]
    return Heard(stream, vocabulary, said)


def alarms_in(heard: Heard, conduct: FusionConfig) -> list[Alarm]:
    """The verdicts that the mesh's own referee gives on a stream, by its own clock."""
    referee = FusionEngine("stream", list(heard.said[0]), heard.vocabulary, conduct)
    alarms: dict[str, Alarm] = {}
    for messages in heard.said:
        for name, message in messages.items():
            referee.receive(name, message, message.captured_ns)
            now_ns = message.captured_ns
        for verdict in referee.step(now_ns).verdicts:
            said_s = (verdict.decided_ns - SECOND_NS) / SECOND_NS
            first = alarms.get(verdict.id, Alarm(verdict.label, said_s, verdict.label))
            alarms[verdict.id] = replace(first, last=verdict.label)
    return list(alarms.values())


def scored(alarms: Sequence[Alarm], stream: Recording, labels: Sequence[str]) -> Score:
    """Alarms against the spans of the stream; of spans whose label is not among `labels` none may be named."""
    rate, found, named, false, at_rest, latencies = stream.rate_hz, set[int](), set[int](), 0, 0, []
    for alarm in alarms:
        if alarm.label == ABSTAIN:
            continue
        near = [
            n
            for n, s in enumerate(stream.spans)
            if s.start / rate - TOLERANCE_S <= alarm.at_s <= s.end / rate + TOLERANCE_S
        ]
        hit = next((n for n in near if stream.spans[n].label == alarm.label and n not in found), None)
        if hit is None:
            false += 1
            at_rest += not near
            named |= {n for n in near if stream.spans[n].label not in labels}
        else:
            found.add(hit)
            latencies.append(alarm.at_s - stream.spans[hit].start / rate)
    moving = sum(s.end - s.start for s in stream.spans)
    rest_s = (len(stream.positions) - moving) / rate
    unlearned = sum(s.label not in labels for s in stream.spans)
    learned = len(stream.spans) - unlearned
    return Score(len(found), false, learned, rest_s, at_rest, tuple(latencies), unlearned, len(named))
