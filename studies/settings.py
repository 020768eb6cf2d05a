"""What to evaluate: the settings, and the folds and trials that follow from them. Seeded, pure."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from common.errors import BadInput
from observer.geometry.views import View
from observer.model.base import Onset
from observer.model.registry import DEFAULT_MODEL
from observer.motion.archive import MotionArchive, Recording
from studies.fusion_engine import DEFAULT_RULE
from studies.trials import EvaluationTrial, Split, make_trials, splits, with_labels

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True)
class EvaluationSettings:
    """What to evaluate; the fields are the options of the command. turn: degrees, or None for a random facing.

    calibrated: observers scale their certainty by how often they are right.
    unlearned: movements that streams show without their having been learned. background: movements of the training
    people that the models know as "something else".
    sensors: for each view its own archive (studies.sensors); empty: all views see one archive. background_archive:
    recordings of other people that the models know as "something else" too. other_motion: streams in which no movement
    of the vocabulary happens. The last two have the archive's body parts and rate.
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
    calibrated: bool = True
    unlearned: tuple[str, ...] = ()
    background: tuple[str, ...] = ()
    seed: int = 0
    sensors: tuple[MotionArchive, ...] = ()
    background_archive: MotionArchive | None = None
    other_motion: tuple[Recording, ...] = ()


def check_names(names: Sequence[str]) -> None:
    """Raises BadInput for two views of one name."""
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise BadInput(f"--views: {twice[0]!r} is given twice; every view needs its own name")


def folds_of(archive: MotionArchive, settings: EvaluationSettings, shown: Sequence[str]) -> list[Split]:
    """Training people, with the background movements, and test people, with the movements `shown`."""
    chosen = with_labels(archive, (*shown, *settings.background))
    folds = splits(chosen, settings.train_subjects, settings.test_subjects, settings.leave_one_subject_out)
    return [
        replace(
            split,
            test=tuple(r for r in split.test if r.label in shown),
            streams=streams_of(archive, {r.subject for r in split.train.recordings}),
        )
        for split in folds
    ]


def streams_of(archive: MotionArchive, people: set[str]) -> tuple[Recording, ...]:
    """All recordings of these people from which models learn something else."""
    return (*continuous(archive, people), *without_movement(archive, people))


def continuous(archive: MotionArchive, people: set[str]) -> tuple[Recording, ...]:
    """The continuous recordings of these people."""
    return tuple(r for r in archive.recordings if r.spans and r.subject in people)


def without_movement(archive: MotionArchive, people: set[str]) -> tuple[Recording, ...]:
    """The recordings of these people in which no movement happens."""
    return tuple(r for r in archive.recordings if not r.spans and not r.label and r.subject in people)


def trials_of(split: Split, settings: EvaluationSettings, number: int) -> list[EvaluationTrial]:
    """The test people's trials as the settings show them; `number` of the split is part of the seed."""
    rng = np.random.default_rng([settings.seed, number])
    judged = [r for r in split.test if r.label in settings.labels]
    return make_trials(judged, onset_known=settings.onset_known, turn=settings.turn, rng=rng)


def onset_of(trial: EvaluationTrial, settings: EvaluationSettings) -> Onset:
    """What the observers know about the begin of the movement."""
    return Onset(known=True, length=len(trial.recording.positions)) if settings.onset_known else Onset()
