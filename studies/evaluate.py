"""`labanmesh evaluate`: learns from some people and judges others, with the observers and rules of the mesh."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from common.probability import encode_facing, uniform
from common.vocabulary import Vocabulary
from observer.geometry.views import View
from observer.learning.learn import learn_view
from observer.model.base import MovementModel, Onset
from observer.model.registry import DEFAULT_MODEL
from observer.motion.archive import MotionArchive
from observer.motion.projected import ProjectedTracker, frames_of
from observer.runtime.pipeline import Observer
from observer.tracks import Floats, Tracker
from studies.faults import HIDDEN, ObserverOutputs, OccludedTracker, disturb
from studies.fusion_engine import DEFAULT_RULE, AgedPosterior, PoolingCase, Rule, get_rule, pool_posteriors
from studies.room import RoomEvent
from studies.trials import EvaluationTrial, Split, make_trials, splits, with_labels

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True)
class EvaluationSettings:
    """What to evaluate; the fields are the options of the command. turn: degrees, or None for a random facing.

    temperature: of the fused posterior. calibrated: observers scale their certainty by how often they are right.
    unlearned: movements that streams show without their having been learned. background: movements of the training
    people that the models know as "something else"; empty: blends of the learned ones only; None: no such class.
    room: what the person does before each trial; observers then do not know the onset.
    """

    views: tuple[View, ...]
    labels: tuple[str, ...]
    train_subjects: tuple[str, ...] = ()
    test_subjects: tuple[str, ...] = ()
    leave_one_subject_out: bool = False
    model: str = DEFAULT_MODEL
    parameters: Mapping[str, float] = field(default_factory=dict)
    rule: str = DEFAULT_RULE
    turn: float | None = 0.0
    faults: Mapping[str, str] = field(default_factory=dict)
    body_parts: tuple[str, ...] = ()
    onset_known: bool = True
    temperature: float = 1.0
    calibrated: bool = True
    unlearned: tuple[str, ...] = ()
    background: tuple[str, ...] | None = None
    room: tuple[RoomEvent, ...] = ()
    seed: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class TrialResult:
    """One trial and the posteriors in each of its F frames: views (F, V, M) by observer, fused (F, M).

    facing: (F, V, M, K) P(facing | movement) by observer, None where no model knows facings. unlearned: (F, V)
    P(none of the movements), NaN where an observer does not estimate it. fused_facing: (F, K).
    """

    trial: EvaluationTrial
    truth: int
    views: Floats
    fused: Floats
    facing: Floats | None = None
    unlearned: Floats | None = None
    fused_facing: Floats | None = None


@dataclass(frozen=True, slots=True, eq=False)
class EvaluationResult:
    """All trials, and the time that learning and judging took."""

    settings: EvaluationSettings
    vocabulary: Vocabulary
    trials: tuple[TrialResult, ...]
    n_train: int
    train_seconds: float
    seconds_per_frame: float

    @property
    def truth(self) -> NDArray[np.int64]:
        """(N,) indices of the true movements."""
        return np.array([result.truth for result in self.trials])

    def at_fraction(self, fraction: float) -> tuple[Floats, Floats]:
        """Posteriors after a fraction of the true segment: (N, V, M) by view, (N, M) fused."""
        frames = [(result, result.trial.frame_at(fraction)) for result in self.trials]
        return np.array([r.views[frame] for r, frame in frames]), np.array([r.fused[frame] for r, frame in frames])

    def at_end(self) -> tuple[Floats, Floats]:
        """Posteriors after the last frame: (N, V, M) by view, (N, M) fused."""
        return np.array([r.views[-1] for r in self.trials]), np.array([r.fused[-1] for r in self.trials])


def evaluate(
    archive: MotionArchive, settings: EvaluationSettings, progress: Progress = lambda *_: None
) -> EvaluationResult:
    """Learn, judge and fuse; raises BadInput for unknown labels, subjects, body parts, models and rules."""
    get_rule(settings.rule, len(settings.views))
    check_names([view.name for view in settings.views])
    vocabulary = Vocabulary(settings.labels)
    results: list[TrialResult] = []
    n_train, train_seconds, judge_seconds, frames = 0, 0.0, 0.0, 0
    folds = folds_of(archive, settings, settings.labels)
    for number, split in enumerate(folds):
        begun = time.perf_counter()
        models = learn(split, vocabulary, settings)
        train_seconds += time.perf_counter() - begun
        n_train += len(split.train.recordings)
        trials = trials_of(split, settings, number)
        begun = time.perf_counter()
        task = f"judging, part {number + 1} of {len(folds)}" if len(folds) > 1 else "judging"
        for n, trial in enumerate(trials, 1):
            results.append(_judge(trial, models, archive.body_parts, vocabulary, settings))
            progress(task, n, len(trials))
        judge_seconds += time.perf_counter() - begun
        frames += sum(len(trial.recording.positions) for trial in trials) * len(models)
    fused = fuse_again(results, settings)
    return EvaluationResult(settings, vocabulary, fused, n_train, train_seconds, judge_seconds / max(frames, 1))


def folds_of(archive: MotionArchive, settings: EvaluationSettings, shown: Sequence[str]) -> list[Split]:
    """Training people, with the background movements, and test people, with the movements `shown`."""
    chosen = with_labels(archive, (*shown, *(settings.background or ())))
    folds = splits(chosen, settings.train_subjects, settings.test_subjects, settings.leave_one_subject_out)
    return [_with_streams(split, archive, shown) for split in folds]


def _with_streams(split: Split, archive: MotionArchive, shown: Sequence[str]) -> Split:
    people = {r.subject for r in split.train.recordings}
    streams = tuple(r for r in archive.recordings if r.spans and r.subject in people)
    return replace(split, test=tuple(r for r in split.test if r.label in shown), streams=streams)


def check_names(names: Sequence[str]) -> None:
    """Raises BadInput for two views of one name."""
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise BadInput(f"--views: {twice[0]!r} is given twice; every view needs its own name")


def learn(split: Split, vocabulary: Vocabulary, settings: EvaluationSettings) -> list[MovementModel]:
    """One model per view from the training people's movements and, if set, their background movements."""
    background = None if settings.background is None else with_labels(split.train, settings.background)
    return [
        learn_view(
            with_labels(split.train, settings.labels),
            view,
            vocabulary,
            kind=settings.model,
            body_parts=settings.body_parts or None,
            parameters=settings.parameters,
            calibrate=settings.calibrated,
            background=background,
            streams=split.streams,
        )
        for view in settings.views
    ]


def trials_of(split: Split, settings: EvaluationSettings, number: int) -> list[EvaluationTrial]:
    """The test people's trials as the settings show them; `number` of the split is part of the seed."""
    rng = np.random.default_rng([settings.seed, number])
    known, turn = settings.onset_known, settings.turn
    return make_trials(split.test, onset_known=known, turn=turn, rng=rng, room=settings.room)


def onset_of(trial: EvaluationTrial, settings: EvaluationSettings) -> Onset:
    """What the observers know about the begin of the movement: nothing after other events in the room."""
    known = settings.onset_known and not settings.room
    return Onset(known=True, length=len(trial.recording.positions)) if known else Onset()


def _observers(
    trial: EvaluationTrial, models: Sequence[MovementModel], recorded: tuple[str, ...], settings: EvaluationSettings
) -> list[Observer]:
    """New observers for one trial, one per view."""
    onset = onset_of(trial, settings)
    third = (trial.end - trial.begin) / 3
    covered = (trial.begin + round(third), trial.begin + round(2 * third))
    observers = []
    for view, model in zip(settings.views, models, strict=True):
        tracker: Tracker = ProjectedTracker(view, recorded, model.header.body_parts)
        if settings.faults.get(view.name) == HIDDEN:
            tracker = OccludedTracker(tracker, *covered)
        observers.append(Observer(tracker, model, onset))
    return observers


def _judge(
    trial: EvaluationTrial,
    models: list[MovementModel],
    recorded: tuple[str, ...],
    vocabulary: Vocabulary,
    settings: EvaluationSettings,
) -> TrialResult:
    observers = _observers(trial, models, recorded, settings)
    outputs = [[o.step(frame) for o in observers] for frame in frames_of(trial.recording)]
    views = np.array([[output.p for output in frame] for frame in outputs])
    unlearned = np.array([[np.nan if o.unlearned is None else o.unlearned for o in frame] for frame in outputs])
    facing = None
    if all(output.facing is not None for output in outputs[0]):
        facing = np.array([[output.facing for output in frame] for frame in outputs])
    truth = vocabulary.index(trial.recording.label)
    return TrialResult(trial, truth, views, np.empty((0, 0)), facing, unlearned)


def fuse_again(results: Sequence[TrialResult], settings: EvaluationSettings) -> tuple[TrialResult, ...]:
    """The same trials with the faults of the settings applied, fused by their rule frame by frame."""
    rule = get_rule(settings.rule, len(settings.views))
    names = [view.name for view in settings.views]
    rate_hz = results[0].trial.recording.rate_hz if results else 1.0
    outputs = [ObserverOutputs(r.views, r.facing, r.unlearned) for r in results]
    disturbed = disturb(outputs, names, settings.faults, rate_hz, settings.seed)
    return tuple(_fused(r, o, rule, settings.temperature) for r, o in zip(results, disturbed, strict=True))


def _fused(result: TrialResult, outputs: ObserverOutputs, rule: Rule, temperature: float) -> TrialResult:
    prior = uniform(outputs.p.shape[2])
    pools = [pool_posteriors(PoolingCase(rule, _votes(outputs, n), prior, temperature)) for n in range(len(outputs.p))]
    facing = np.array([pool.facing for pool in pools]) if pools[0].facing is not None else None
    fused = np.array([pool.p for pool in pools])
    return TrialResult(
        result.trial, result.truth, outputs.p, fused, outputs.facing, outputs.unlearned, fused_facing=facing
    )


def _votes(outputs: ObserverOutputs, frame: int) -> list[AgedPosterior]:
    """The votes as the fusion engine has them when the outputs arrive over the mesh at once."""
    votes = []
    for v, p in enumerate(outputs.p[frame]):
        surprise = None if outputs.facing is None else encode_facing(outputs.facing[frame, v])
        unlearned = None if outputs.unlearned is None else outputs.unlearned[frame, v]
        if unlearned is not None and np.isnan(unlearned):
            unlearned = None
        votes.append(AgedPosterior(str(v), p, 0.0, 0.0, "counted", unlearned=unlearned, surprise=surprise))
    return votes
