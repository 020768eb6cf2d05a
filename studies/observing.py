"""The output of each observer on people that its model has not learned from: the costly part of an evaluation.

Observers do not know of each other, so that each fold of each observer is a part of its own (common.parallel): its
model is learned once, and judges trials, streams and other motion.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from common.parallel import run_parts
from common.vocabulary import Vocabulary, agreed_times
from observer.geometry.views import View
from observer.learning.learn import learn_view
from observer.model.base import MovementModel, Onset
from observer.motion.archive import MotionArchive, Recording
from observer.motion.projected import ProjectedTracker, frames_of
from observer.runtime.pipeline import Observer
from observer.tracks import Floats, Tracker
from studies.sensors import same_streams, same_trials
from studies.settings import (
    EvaluationSettings,
    Progress,
    continuous,
    folds_of,
    onset_of,
    streams_of,
    trials_of,
    without_movement,
)
from studies.trials import EvaluationTrial, Split, strung, with_labels


@dataclass(frozen=True, slots=True, eq=False)
class OutputCourse:
    """The output of one observer in the F frames of one recording.

    p (F, M); rest (F,); visible (F,) whether any body part is seen; unlearned (F,), NaN where it is not estimated;
    facing (F, M, K), None for a model without facings.
    """

    p: Floats
    rest: Floats
    visible: Floats
    unlearned: Floats
    facing: Floats | None = None

    def at(self, frames: NDArray[np.int64]) -> "OutputCourse":
        """The outputs in those frames."""
        facing = None if self.facing is None else self.facing[frames]
        return OutputCourse(self.p[frames], self.rest[frames], self.visible[frames], self.unlearned[frames], facing)


@dataclass(frozen=True, slots=True, eq=False)
class FoldPart:
    """One observer's part of one fold. train: what it learns from; trials: None where it has no recording."""

    settings: EvaluationSettings
    view: View
    train: Split
    trials: Sequence[EvaluationTrial | None]
    streams: Sequence[Recording]


@dataclass(frozen=True, slots=True, eq=False)
class FoldCourses:
    """The output of one observer in one fold, with the seconds and frames that it took, and its vocabulary."""

    trials: Sequence[OutputCourse | None]
    streams: Sequence[OutputCourse]
    train_seconds: float
    judge_seconds: float
    frames: int
    vocabulary: Vocabulary


@dataclass(frozen=True, slots=True, eq=False)
class ObservedFold:
    """The trials and streams of one fold, and by observer what it outputs about them.

    streams: the movements of the test people first, then `other_motion`, in which none happens.
    """

    trials: Sequence[EvaluationTrial]
    streams: Sequence[Recording]
    other_motion: int
    courses: Sequence[FoldCourses]
    n_train: int

    @property
    def stream_courses(self) -> list[tuple[Recording, list[OutputCourse]]]:
        """Each stream with the output of every observer."""
        return [(stream, [each.streams[n] for each in self.courses]) for n, stream in enumerate(self.streams)]

    @property
    def vocabulary(self) -> Vocabulary:
        """The vocabulary with the durations that a fusion service judges by: the observers agree on them."""
        known = [each.vocabulary for each in self.courses]
        return replace(known[0], movements=agreed_times(known))


def observe_folds(
    archive: MotionArchive,
    settings: EvaluationSettings,
    progress: Progress = lambda *_: None,
    jobs: int = 1,
    *,
    trials: bool = True,
    streams: bool = False,
) -> list[ObservedFold]:
    """Learn all folds and observe the trials, the streams, or both.

    Raises BadInput for unknown labels, subjects, body parts and models.
    """
    shown = (*settings.labels, *settings.unlearned) if streams else settings.labels
    splits = folds_of(archive, settings, shown)
    folds = [_watched(archive, split, settings, number, trials, streams) for number, split in enumerate(splits)]
    parts = [
        _part_of(split, fold, settings, number, v)
        for number, (split, fold) in enumerate(zip(splits, folds, strict=True))
        for v in range(len(settings.views))
    ]
    courses = run_parts(observe_part, parts, jobs, partial(progress, "learning and judging"))
    by_fold = len(settings.views)
    return [replace(fold, courses=courses[n * by_fold : (n + 1) * by_fold]) for n, fold in enumerate(folds)]


def _watched(
    archive: MotionArchive, split: Split, settings: EvaluationSettings, number: int, trials: bool, streams: bool
) -> ObservedFold:
    """The trials and streams of a fold, not observed yet."""
    people = {r.subject for r in split.test}
    moving: Sequence[Recording] = ()
    if streams:
        moving = continuous(archive, people) or strung(split.test, _rng(settings, number))
    learned = (*settings.labels, *settings.background)
    n_train = sum(r.label in learned for r in split.train.recordings)
    other = (*(without_movement(archive, people) if streams else ()), *settings.other_motion)
    shown = trials_of(split, settings, number) if trials else []
    return ObservedFold(shown, (*moving, *other), len(other), (), n_train)


def _rng(settings: EvaluationSettings, number: int) -> np.random.Generator:
    """For the streams of a fold: the same for all sensors, whose recordings are strung together alike."""
    return np.random.default_rng([settings.seed, number, 2])


def _part_of(split: Split, fold: ObservedFold, settings: EvaluationSettings, number: int, v: int) -> FoldPart:
    """The observer's part of a fold: with sensors, what its own sensor recorded."""
    alone = replace(settings, sensors=(), other_motion=())
    if not settings.sensors:
        return FoldPart(alone, settings.views[v], replace(split, test=()), fold.trials, fold.streams)
    own = settings.sensors[v]
    people = {r.subject for r in split.train.recordings}
    mine = MotionArchive(own.body_parts, tuple(r for r in own.recordings if r.subject in people))
    train = Split(mine, (), streams_of(own, people))
    judged = fold.streams[: len(fold.streams) - fold.other_motion]
    streams = same_streams(own, judged)
    if judged and not continuous(own, {r.subject for r in split.test}):
        streams = strung(same_streams(own, split.test), _rng(settings, number))
    other = fold.streams[len(judged) :]
    lives = len(other) - len(settings.other_motion)
    other = [*same_streams(own, other[:lives]), *other[lives:]]
    return FoldPart(alone, settings.views[v], train, same_trials(own, fold.trials), [*streams, *other])


def observe_part(part: FoldPart) -> FoldCourses:
    """Learn the observer's model and observe everything that the part shows."""
    begun = time.perf_counter()
    model = learn_observer(part.train, part.view, Vocabulary(part.settings.labels), part.settings)
    learned = time.perf_counter()
    trials = [None if trial is None else _watch_trial(trial, part, model) for trial in part.trials]
    streams = [watch(Observer(_tracker(part, model), model, Onset()), stream) for stream in part.streams]
    frames = sum(len(course.p) for course in (*trials, *streams) if course is not None)
    return FoldCourses(trials, streams, learned - begun, time.perf_counter() - learned, frames, model.header.vocabulary)


def learn_observer(split: Split, view: View, vocabulary: Vocabulary, settings: EvaluationSettings) -> MovementModel:
    """Learn one view's model from the training people's movements and streams, and from a background if one is set."""
    return learn_view(
        with_labels(split.train, settings.labels),
        view,
        vocabulary,
        kind=settings.model,
        body_parts=settings.body_parts or None,
        parameters=settings.parameters,
        calibrate=settings.calibrated,
        background=_background_of(split, settings),
        streams=split.streams,
    )


def _background_of(split: Split, settings: EvaluationSettings) -> MotionArchive | None:
    if not settings.background and settings.background_archive is None:
        return None
    own = with_labels(split.train, settings.background).recordings
    others = () if settings.background_archive is None else settings.background_archive.recordings
    return MotionArchive(split.train.body_parts, (*own, *others))


def _tracker(part: FoldPart, model: MovementModel) -> Tracker:
    return ProjectedTracker(part.view, part.train.train.body_parts, model.header.body_parts)


def _watch_trial(trial: EvaluationTrial, part: FoldPart, model: MovementModel) -> OutputCourse:
    ends = trial.end == len(trial.recording.positions)
    observer = Observer(_tracker(part, model), model, onset_of(trial, part.settings))
    return watch(observer, trial.recording, ends=ends)


def watch(observer: Observer, recording: Recording, ends: bool = False) -> OutputCourse:
    """The output of a new observer in each frame of a recording.

    ends: the movement ends with the recording, and the last output is that of an observer that has noticed.
    """
    outputs = []
    for number, frame in enumerate(frames_of(recording), 1):
        output = observer.step(frame)
        if ends and number == len(recording.positions):
            output = observer.end() or output
        outputs.append(output)
    rest = np.array([output.rest for output in outputs])
    visible = np.array([any(output.visible.values()) for output in outputs], dtype=np.float64)
    p = np.array([output.p for output in outputs])
    unlearned = np.array([np.nan if o.unlearned is None else o.unlearned for o in outputs])
    facing = None if outputs[0].facing is None else np.array([output.facing for output in outputs])
    return OutputCourse(p, rest, visible, unlearned, facing)
