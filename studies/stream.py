"""Judging continuous streams: the observers' outputs through the fusion engine, frame by frame."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from common import SECOND_NS
from common.config_sections import FusionConfig
from common.messages import JudgementMessage, PosteriorMessage
from common.parallel import run_parts
from common.vocabulary import Vocabulary
from observer.motion.archive import MotionArchive, Recording
from observer.runtime.pipeline import Posterior, PosteriorEncoder
from studies.evaluate import fusion_of
from studies.fusion_engine import FusionEngine, step
from studies.observing import ObservedFold, OutputCourse, observe_folds
from studies.settings import EvaluationSettings, Progress
from studies.spotting import JudgedStream, StreamResult, StreamScores, StreamVerdict, total_score

THRESHOLDS = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
"""Values of [fusion] threshold to compare when unlearned movements are shown."""


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
    folds = observe_folds(archive, settings, progress, trials=False, streams=True)
    return judge_observed(folds, settings, progress).as_json()


def judge_observed(
    folds: Sequence[ObservedFold], settings: EvaluationSettings, progress: Progress = lambda *_: None, jobs: int = 1
) -> StreamResult:
    """Judge the streams that were observed."""
    config = fusion_of(settings)
    configs = [config, *(config.model_copy(update={"threshold": t}) for t in THRESHOLDS if settings.unlearned)]
    parts = [(*part, fold.vocabulary) for fold in folds for part in fold.stream_courses]
    judge = partial(_judged, configs=configs)
    results = run_parts(judge, parts, jobs, partial(progress, "judging streams"))
    other = [n >= len(fold.streams) - fold.other_motion for fold in folds for n in range(len(fold.streams))]
    chosen = [result for result, is_other in zip(results, other, strict=True) if not is_other]
    by_threshold = {
        config.threshold: total_score(StreamScores.of(result[n], settings.labels) for result in chosen)
        for n, config in enumerate(configs[1:], 1)
    }
    others = tuple(result[0] for result, is_other in zip(results, other, strict=True) if is_other)
    return StreamResult(settings.labels, tuple(result[0] for result in chosen), others, by_threshold)


def _judged(
    part: tuple[Recording, Sequence[OutputCourse], Vocabulary], configs: Sequence[FusionConfig]
) -> list[JudgedStream]:
    """One stream, judged by each fusion service."""
    observed = observed_stream(*part)
    return [judged_stream(observed, config) for config in configs]


def observed_stream(recording: Recording, courses: Sequence[OutputCourse], vocabulary: Vocabulary) -> ObservedStream:
    """The messages of observers about a recording; of its frames only the number and the rate count."""
    encoders = [PosteriorEncoder(vocabulary, "stream") for _ in courses]
    interval_ns = SECOND_NS / recording.rate_hz
    messages = []
    for n in range(len(recording.positions)):
        at_ns = SECOND_NS + round(n * interval_ns)
        messages.append(
            {
                f"view-{v}": encoder.encode(posterior_at(course, n), at_ns, at_ns)
                for v, (course, encoder) in enumerate(zip(courses, encoders, strict=True))
                if np.isfinite(course.p[n, 0])
            }
        )
    return ObservedStream(recording, vocabulary, messages)


def posterior_at(course: OutputCourse, frame: int) -> Posterior:
    """The observer's state after that frame."""
    facing = None if course.facing is None else course.facing[frame]
    unlearned = float(course.unlearned[frame])
    return Posterior(
        course.p[frame],
        float(course.rest[frame]),
        frame + 1,
        {"body": bool(course.visible[frame])},
        facing=facing,
        unlearned=None if np.isnan(unlearned) else unlearned,
    )


def judged_stream(stream: ObservedStream, config: FusionConfig) -> JudgedStream:
    """The verdicts and the judgements of the fusion engine on a stream; its clock is the capture time."""
    engine = FusionEngine("stream", list(stream.messages[0]), stream.vocabulary, config)
    verdicts: dict[str, StreamVerdict] = {}
    answers = []
    for messages in stream.messages:
        now_ns = max(message.captured_ns for message in messages.values())
        output = step(engine, messages, now_ns)
        answers.append(_answer(output.judgement))
        for verdict in output.verdicts:
            decided_s, began_s = (_seconds(at_ns) for at_ns in (verdict.decided_ns, verdict.began_ns))
            ended_s = None if verdict.ended_ns is None else _seconds(verdict.ended_ns)
            first = verdicts.get(verdict.id, StreamVerdict(verdict.label, decided_s, verdict.label, began_s))
            verdicts[verdict.id] = replace(first, last=verdict.label, ended_s=ended_s)
    return JudgedStream(stream.recording, list(verdicts.values()), answers)


def _answer(judgement: JudgementMessage) -> str:
    """The movement that goes on, "" while the person rests or does something else more probably."""
    unlearned = judgement.unlearned or 0.0
    is_movement = judgement.movement is not None and max(judgement.p) * (1.0 - unlearned) > unlearned
    return judgement.label if is_movement else ""


def _seconds(at_ns: int) -> float:
    return (at_ns - SECOND_NS) / SECOND_NS
