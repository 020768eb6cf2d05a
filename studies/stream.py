"""Judging without end: spotting movements in a continuous stream (MSRC-12's protocol).

A verdict is right when it names the movement and falls within 333 ms of its span, once a movement; every other
verdict is a false alarm, abstentions aside. What is scored is the first word of a verdict, not its correction: a home
acts on it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.config import FusionConfig
from common.messages import ABSTAIN, PosteriorMessage, VocabularyReference
from common.vocabulary import Vocabulary
from fusion.referee import Referee
from observer.learning import frames_of
from observer.model.base import MovementModel, Onset
from observer.motion.archive import MotionArchive, Recording, Span
from observer.pipeline import Observer, Opinion
from observer.projected import ProjectedTracker
from studies.evaluate import Question, learn
from studies.trials import IDLE_NOISE_M, splits, with_labels

TOLERANCE_S = 0.333
BETWEEN_S = (1.0, 2.5)
SECOND_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Alarm:
    """The first word of a verdict: what, and when it was said, in seconds from the stream's start."""

    label: str
    at_s: float


@dataclass(frozen=True, slots=True)
class Score:
    """Counts over streams; latencies in seconds from the begin of a movement to its right verdict."""

    right: int = 0
    false: int = 0
    movements: int = 0
    rest_s: float = 0.0
    alarms_at_rest: int = 0
    latencies_s: tuple[float, ...] = ()

    def plus(self, other: "Score") -> "Score":
        """Both together."""
        return Score(
            self.right + other.right,
            self.false + other.false,
            self.movements + other.movements,
            self.rest_s + other.rest_s,
            self.alarms_at_rest + other.alarms_at_rest,
            self.latencies_s + other.latencies_s,
        )

    def as_json(self) -> dict[str, float | None]:
        """The contract's `stream`."""
        said, precision = self.right + self.false, self.right / max(self.right + self.false, 1)
        recall = self.right / max(self.movements, 1)
        return {
            "f1": 2 * self.right / max(said + self.movements, 1),
            "precision": precision,
            "recall": recall,
            "false_alarms_per_minute": self.alarms_at_rest / max(self.rest_s / 60, 1e-9),
            "median_latency_s": float(np.median(self.latencies_s)) if self.latencies_s else None,
        }


def judge_stream(
    archive: MotionArchive, question: Question, progress: Callable[[str, int, int], None] = lambda *_: None
) -> dict[str, Any]:
    """Judge the test people's streams: continuous recordings as they are, else their recordings strung together."""
    chosen = with_labels(archive, question.labels)
    vocabulary = Vocabulary(question.labels)
    score = Score()
    for number, split in enumerate(
        splits(chosen, question.train_subjects, question.test_subjects, question.leave_one_subject_out)
    ):
        models = learn(split, vocabulary, question)
        rng = np.random.default_rng([question.seed, number, 2])
        people = {r.subject for r in split.test}
        whole = [r for r in archive.recordings if r.spans and r.subject in people]
        streams = whole or strung(split.test, rng)
        for n, stream in enumerate(streams):
            alarms = alarms_in(stream, models, archive.body_parts, question)
            score = score.plus(scored(alarms, stream))
            progress("judging streams", n + 1, len(streams))
    return score.as_json()


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


def alarms_in(
    stream: Recording, models: Sequence[MovementModel], recorded: tuple[str, ...], question: Question
) -> list[Alarm]:
    """The verdicts that the mesh's own observers and referee give on a stream, by its own clock."""
    names = [f"view-{v}" for v in range(len(models))]
    observers = [
        Observer(ProjectedTracker(view, recorded, model.header.body_parts), model, Onset())
        for view, model in zip(question.views, models, strict=True)
    ]
    vocabulary = models[0].header.vocabulary
    conduct = FusionConfig(rule=question.rule, quorum=len(names) // 2 + 1)
    referee = Referee("stream", names, vocabulary, conduct)
    alarms: dict[str, Alarm] = {}
    for n, frame in enumerate(frames_of(stream, start_ns=SECOND_NS)):
        for name, observer in zip(names, observers, strict=True):
            referee.hear(
                name, _message(name, observer.step(frame), n, frame.captured_ns, vocabulary), frame.captured_ns
            )
        for verdict in referee.judge(frame.captured_ns).verdicts:
            alarms.setdefault(verdict.id, Alarm(verdict.label, (verdict.decided_ns - SECOND_NS) / SECOND_NS))
    return [alarm for alarm in alarms.values() if alarm.label != ABSTAIN]


def _message(name: str, opinion: Opinion, seq: int, now_ns: int, vocabulary: Vocabulary) -> PosteriorMessage:
    return PosteriorMessage(
        scene="stream",
        observer=name,
        seq=seq,
        session="stream",
        captured_ns=now_ns,
        sent_ns=now_ns,
        vocabulary=VocabularyReference(name=vocabulary.name, hash=vocabulary.digest),
        p=opinion.p.tolist(),
        rest=opinion.rest,
        frames=opinion.frames,
    )


def scored(alarms: Sequence[Alarm], stream: Recording) -> Score:
    """Alarms against the spans of the stream."""
    rate, found, false, at_rest, latencies = stream.rate_hz, set[int](), 0, 0, []
    for alarm in alarms:
        near = [
            n
            for n, s in enumerate(stream.spans)
            if s.start / rate - TOLERANCE_S <= alarm.at_s <= s.end / rate + TOLERANCE_S
        ]
        hit = next((n for n in near if stream.spans[n].label == alarm.label and n not in found), None)
        if hit is None:
            false += 1
            at_rest += not near
        else:
            found.add(hit)
            latencies.append(alarm.at_s - stream.spans[hit].start / rate)
    moving = sum(s.end - s.start for s in stream.spans)
    rest_s = (len(stream.positions) - moving) / rate
    return Score(len(found), false, len(stream.spans), rest_s, at_rest, tuple(latencies))
