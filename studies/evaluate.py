"""`labanmesh evaluate`: train on some people, judge others, count. The observers and the rule are the mesh's own."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from common.probability import encode_facing, uniform
from common.vocabulary import Vocabulary
from fusion.engine.pooling import PoolingCase, pool_posteriors
from fusion.engine.roster import AgedPosterior
from fusion.engine.rules import DEFAULT_RULE, Rule, get_rule
from observer.geometry.views import View
from observer.learning.learn import learn_view
from observer.model.base import MovementModel, Onset
from observer.model.registry import DEFAULT_MODEL
from observer.motion.archive import MotionArchive
from observer.motion.projected import ProjectedTracker, frames_of
from observer.runtime.pipeline import Observer
from observer.tracks import Tracker
from studies.faults import HIDDEN, Hidden, Said, disturb
from studies.trials import Split, Trial, splits, trials, with_labels

Floats = NDArray[np.float64]
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True)
class Question:
    """What to evaluate; the fields are the options of the command. turn: degrees, or None for any facing.

    temperature: of the fused belief. calibrated: the observers know how far they can be believed. unlearned: movements
    that are shown in streams without having been learned. background: movements by which the models know something
    else, of the training people; none of them: by blends alone; None: they do not.
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
    seed: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """One trial and what was believed in every frame: views (F, V, M) by each observer, fused (F, M).

    facing: (F, V, M, K) P(facing | movement) by each observer, None where no model knows facings; unlearned: (F, V)
    P(none of the movements), NaN where an observer cannot tell. faced: (F, K) the fused facing.
    """

    trial: Trial
    truth: int
    views: Floats
    fused: Floats
    facing: Floats | None = None
    unlearned: Floats | None = None
    faced: Floats | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """All judged trials, and what it took."""

    question: Question
    vocabulary: Vocabulary
    judged: tuple[Judged, ...]
    n_train: int
    train_seconds: float
    seconds_per_frame: float


def evaluate(archive: MotionArchive, question: Question, progress: Progress = lambda *_: None) -> Answer:
    """Answer the question.

    Raises BadInput for labels, subjects, body parts, models or rules that are not there.
    """
    get_rule(question.rule, len(question.views))
    _check_names([view.name for view in question.views])
    vocabulary = Vocabulary(question.labels)
    judged: list[Judged] = []
    n_train, train_seconds, watch_seconds, frames = 0, 0.0, 0.0, 0
    folds = folds_of(archive, question, question.labels)
    for number, split in enumerate(folds):
        begun = time.perf_counter()
        models = learn(split, vocabulary, question)
        train_seconds += time.perf_counter() - begun
        n_train += len(split.train.recordings)
        part = trials_of(split, question, number)
        begun = time.perf_counter()
        for n, trial in enumerate(part):
            judged.append(_judge(trial, models, archive.body_parts, vocabulary, question))
            progress(f"judging, part {number + 1} of {len(folds)}" if len(folds) > 1 else "judging", n + 1, len(part))
        watch_seconds += time.perf_counter() - begun
        frames += sum(len(trial.recording.positions) for trial in part) * len(models)
    result = refused(judged, question, vocabulary)
    return Answer(question, vocabulary, result, n_train, train_seconds, watch_seconds / max(frames, 1))


def folds_of(archive: MotionArchive, question: Question, shown: Sequence[str]) -> list[Split]:
    """Who is learned from, with what else the models are to know, and who is judged, by the movements `shown`."""
    chosen = with_labels(archive, (*shown, *(question.background or ())))
    found = splits(chosen, question.train_subjects, question.test_subjects, question.leave_one_subject_out)
    return [replace(split, test=tuple(r for r in split.test if r.label in shown)) for split in found]


def _check_names(names: Sequence[str]) -> None:
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise BadInput(f"--views: {twice[0]!r} stands twice; every view needs a name of its own")


def learn(split: Split, vocabulary: Vocabulary, question: Question) -> list[MovementModel]:
    """One model a view, from the training people: their movements, and with a background what else they did."""
    background = None if question.background is None else with_labels(split.train, question.background)
    return [
        learn_view(
            with_labels(split.train, question.labels),
            view,
            vocabulary,
            kind=question.model,
            body_parts=question.body_parts or None,
            parameters=question.parameters,
            tried=question.calibrated,
            background=background,
        )
        for view in question.views
    ]


def trials_of(split: Split, question: Question, number: int) -> list[Trial]:
    """The test people's trials as the question wants them shown; `number` of the split seeds them."""
    rng = np.random.default_rng([question.seed, number])
    return trials(split.test, onset_known=question.onset_known, turn=question.turn, rng=rng)


def observers_of(
    trial: Trial, models: Sequence[MovementModel], recorded: tuple[str, ...], question: Question
) -> list[Observer]:
    """Fresh observers for one trial, one a view."""
    onset = Onset(known=True, length=len(trial.recording.positions)) if question.onset_known else Onset()
    third = (trial.end - trial.begin) / 3
    covered = (trial.begin + round(third), trial.begin + round(2 * third))
    observers = []
    for view, model in zip(question.views, models, strict=True):
        tracker: Tracker = ProjectedTracker(view, recorded, model.header.body_parts)
        if question.faults.get(view.name) == HIDDEN:
            tracker = Hidden(tracker, *covered)
        observers.append(Observer(tracker, model, onset))
    return observers


def _judge(
    trial: Trial, models: list[MovementModel], recorded: tuple[str, ...], vocabulary: Vocabulary, question: Question
) -> Judged:
    observers = observers_of(trial, models, recorded, question)
    said = [[o.step(frame) for o in observers] for frame in frames_of(trial.recording)]
    views = np.array([[opinion.p for opinion in frame] for frame in said])
    unlearned = np.array([[np.nan if o.unlearned is None else o.unlearned for o in frame] for frame in said])
    facing = None
    if all(opinion.facing is not None for opinion in said[0]):
        facing = np.array([[opinion.facing for opinion in frame] for frame in said])
    truth = vocabulary.index(trial.recording.label)
    return Judged(trial, truth, views, np.empty((0, 0)), facing, unlearned)


def refused(judged: Sequence[Judged], question: Question, vocabulary: Vocabulary) -> tuple[Judged, ...]:
    """The same trials with the question's faults put in and fused by its rule, frame by frame."""
    rule = get_rule(question.rule, len(question.views))
    names = [view.name for view in question.views]
    said = [Said(j.views, j.facing, j.unlearned) for j in judged]
    disturbed = disturb(said, names, question.faults, _rate(judged), question.seed)
    return tuple(_fused(j, s, rule, question.temperature) for j, s in zip(judged, disturbed, strict=True))


def _fused(judged: Judged, said: Said, rule: Rule, temperature: float) -> Judged:
    prior = uniform(said.p.shape[2])
    pools = [pool_posteriors(PoolingCase(rule, _opinions(said, n), prior, temperature)) for n in range(len(said.p))]
    faced = np.array([pool.facing for pool in pools]) if pools[0].facing is not None else None
    fused = np.array([pool.p for pool in pools])
    return Judged(judged.trial, judged.truth, said.p, fused, said.facing, said.unlearned, faced)


def _opinions(said: Said, frame: int) -> list[AgedPosterior]:
    """As the referee would have them, had they come over the mesh."""
    opinions = []
    for v, p in enumerate(said.p[frame]):
        surprise = None if said.facing is None else encode_facing(said.facing[frame, v])
        unlearned = None if said.unlearned is None or np.isnan(said.unlearned[frame, v]) else said.unlearned[frame, v]
        opinions.append(AgedPosterior(str(v), p, 0.0, 0.0, "counted", unlearned=unlearned, surprise=surprise))
    return opinions


def _rate(judged: Sequence[Judged]) -> float:
    return judged[0].trial.recording.rate_hz if judged else 1.0


def at_fraction(judged: Sequence[Judged], fraction: float) -> tuple[Floats, Floats]:
    """Beliefs when a fraction of the true segment has been seen: (N, V, M) by view, (N, M) fused."""
    frames = [j.trial.frame_at(fraction) for j in judged]
    return (
        np.array([j.views[f] for j, f in zip(judged, frames, strict=True)]),
        np.array([j.fused[f] for j, f in zip(judged, frames, strict=True)]),
    )


def at_end(judged: Sequence[Judged]) -> tuple[Floats, Floats]:
    """Beliefs after the last frame: (N, V, M) by view, (N, M) fused."""
    return np.array([j.views[-1] for j in judged]), np.array([j.fused[-1] for j in judged])


def typical_confusion(judged: Sequence[Judged], view: int) -> Iterator[Judged]:
    """Trials that this view judges wrong at the end and the fusion right, the clearest resolution first."""
    resolved = [j for j in judged if j.views[-1, view].argmax() != j.truth and j.fused[-1].argmax() == j.truth]
    yield from sorted(resolved, key=lambda j: -j.fused[-1, j.truth])
