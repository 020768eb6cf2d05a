"""`labanmesh evaluate`: learns from some people and judges others, with the observers and rules of the mesh."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.config_sections import FusionConfig, default_quorum
from common.probability import encode_facing, uniform
from common.vocabulary import Vocabulary
from observer.model.base import MovementModel
from observer.motion.archive import MotionArchive
from observer.tracks import Floats
from studies.faults import ObserverOutputs, disturb
from studies.fusion_engine import (
    AgedPosterior,
    FusionEngine,
    PoolingCase,
    first_word,
    get_rule,
    pool_many,
    steady_trusts,
)
from studies.observing import ObservedFold, OutputCourse, learn_observer, observe_folds
from studies.sensors import frames_at_fractions
from studies.settings import EvaluationSettings, Progress, check_names
from studies.trials import EvaluationTrial, Split


@dataclass(frozen=True, slots=True, eq=False)
class TrialResult:
    """One trial and the posteriors in each of its F frames: views (F, V, M) by observer, fused (F, M).

    An observer whose sensor has no recording of the trial is NaN. facing: (F, V, M, K) P(facing | movement) by
    observer, None where no model knows facings. unlearned: (F, V) P(none of the movements), NaN where an observer does
    not estimate it. fused_facing: (F, K). rest: (F, V) P(at rest), None if it is not known. first_word: frame and
    movement of the first verdict that names one, None without such a verdict or while rest is not known.
    """

    trial: EvaluationTrial
    truth: int
    views: Floats
    fused: Floats
    facing: Floats | None = None
    unlearned: Floats | None = None
    fused_facing: Floats | None = None
    rest: Floats | None = None
    first_word: tuple[int, int] | None = None

    @property
    def judged_by(self) -> NDArray[np.bool_]:
        """(V,) which observers have a recording of the trial."""
        recorded: NDArray[np.bool_] = np.isfinite(self.views[0, :, 0])
        return recorded


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
    archive: MotionArchive, settings: EvaluationSettings, progress: Progress = lambda *_: None, jobs: int = 1
) -> EvaluationResult:
    """Learn, judge and fuse; raises BadInput for unknown labels, subjects, body parts, models and rules.

    jobs: the number of processes to share the work.
    """
    require_fits(settings)
    return results_of(observe_folds(archive, settings, progress, jobs), settings)


def require_fits(settings: EvaluationSettings) -> None:
    """Raise BadInput for an unknown rule, and for two views of one name."""
    get_rule(settings.rule, "--rule")
    check_names([view.name for view in settings.views])


def results_of(folds: Sequence[ObservedFold], settings: EvaluationSettings) -> EvaluationResult:
    """The result of what was observed."""
    results = [
        _joined(trial, [courses.trials[n] for courses in fold.courses], settings)
        for fold in folds
        for n, trial in enumerate(fold.trials)
    ]
    courses = [fold_courses for fold in folds for fold_courses in fold.courses]
    frames, seconds = sum(c.frames for c in courses), sum(c.judge_seconds for c in courses)
    return EvaluationResult(
        settings,
        Vocabulary(settings.labels),
        fuse_again(results, settings),
        sum(fold.n_train for fold in folds),
        sum(c.train_seconds for c in courses),
        seconds / max(frames, 1),
    )


def _joined(
    trial: EvaluationTrial, courses: Sequence[OutputCourse | None], settings: EvaluationSettings
) -> TrialResult:
    """What all observers output in each frame of the trial; of other sensors, after equal fractions of theirs."""
    frames, movements = len(trial.recording.positions), len(settings.labels)
    shown = [None if c is None else c.at(frames_at_fractions(len(c.p), frames)) for c in courses]
    nothing = np.full(frames, np.nan)
    facings = [c.facing for c in shown if c is not None and c.facing is not None]
    facing = None
    if facings and len(facings) == sum(c is not None for c in shown):
        unknown = np.full_like(facings[0], 1.0 / facings[0].shape[2])
        facing = np.stack([unknown if c is None or c.facing is None else c.facing for c in shown], axis=1)
    return TrialResult(
        trial,
        settings.labels.index(trial.recording.label),
        np.stack([np.full((frames, movements), np.nan) if c is None else c.p for c in shown], axis=1),
        np.empty((0, 0)),
        facing,
        np.stack([nothing if c is None else c.unlearned for c in shown], axis=1),
        rest=np.stack([nothing if c is None else c.rest for c in shown], axis=1),
    )


def learn(split: Split, vocabulary: Vocabulary, settings: EvaluationSettings) -> list[MovementModel]:
    """One model per view from the training people's movements and, if set, their background movements."""
    return [learn_observer(split, view, vocabulary, settings) for view in settings.views]


def fuse_again(results: Sequence[TrialResult], settings: EvaluationSettings) -> tuple[TrialResult, ...]:
    """The same trials with the faults of the settings applied, fused by their rule frame by frame."""
    names = [view.name for view in settings.views]
    rate_hz = results[0].trial.recording.rate_hz if results else 1.0
    outputs = [ObserverOutputs(r.views, r.facing, r.unlearned) for r in results]
    disturbed = disturb(outputs, names, settings.faults, rate_hz, settings.seed)
    # A sensor without a recording has no output, also if it is faulty.
    shown = [
        replace(r, views=np.where(np.isnan(r.views), np.nan, o.p), facing=o.facing, unlearned=o.unlearned)
        for r, o in zip(results, disturbed, strict=True)
    ]
    return tuple(_fused(result, settings) for result in shown)


def _fused(result: TrialResult, settings: EvaluationSettings) -> TrialResult:
    rule, prior = get_rule(settings.rule, "--rule"), uniform(result.views.shape[2])
    trusts = _steady_trusts(result)
    cases = [PoolingCase(rule, _votes(result, n, trusts[n]), prior) for n in range(len(result.views))]
    pools = pool_many(cases)
    facing = np.array([pool.facing for pool in pools]) if pools[0].facing is not None else None
    word = None
    if result.rest is not None:
        names, vocabulary = [str(v) for v in range(len(settings.views))], Vocabulary(settings.labels)
        engine = FusionEngine("trial", names, vocabulary, fusion_of(settings))
        first = first_word(engine, cases, pools, result.trial.recording.rate_hz)
        word = None if first is None else (first[0], vocabulary.index(first[1]))
    return replace(result, fused=np.array([pool.p for pool in pools]), fused_facing=facing, first_word=word)


def fusion_of(settings: EvaluationSettings) -> FusionConfig:
    """The fusion service that judges: the settings' rule, otherwise as by default."""
    quorum = default_quorum(len(settings.views))
    return FusionConfig(rule=settings.rule, quorum=quorum)


def _steady_trusts(result: TrialResult) -> Floats:
    """(F, V) the trust in each observer by its own course in each frame, as the fusion engine has it."""
    neutral = 1.0 / (result.views.shape[2] + 1)
    unlearned = np.full(result.views.shape[:2], np.nan) if result.unlearned is None else result.unlearned
    unlearned = np.nan_to_num(unlearned, nan=neutral)[:, :, None]
    answers = np.concatenate([result.views * (1.0 - unlearned), unlearned], axis=2)
    judged = np.flatnonzero(result.judged_by)
    trusts = np.ones(answers.shape[:2])
    trusts[:, judged] = steady_trusts(answers[:, judged], result.trial.recording.rate_hz)
    return trusts


def _votes(result: TrialResult, frame: int, trusts: Floats) -> list[AgedPosterior]:
    """The votes as the fusion engine has them when the outputs arrive over the mesh at once."""
    votes = []
    for v, p in enumerate(result.views[frame]):
        if np.isnan(p[0]):
            continue
        surprise = None if result.facing is None else encode_facing(result.facing[frame, v])
        unlearned = None if result.unlearned is None else result.unlearned[frame, v]
        if unlearned is not None and np.isnan(unlearned):
            unlearned = None
        rest = 0.0 if result.rest is None else float(result.rest[frame, v])
        reliability = float(trusts[v])
        votes.append(
            AgedPosterior(
                str(v), p, rest, 0.0, "counted", unlearned=unlearned, surprise=surprise, reliability=reliability
            )
        )
    return votes
