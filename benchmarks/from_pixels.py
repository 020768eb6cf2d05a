"""What an evaluation loses through pictures: virtual cameras film recorded people, and camshift tracks them.

python -m benchmarks.from_pixels msr.npz --views door --scenery cluttered
"""

import sys
import threading
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks.command_line import run_command
from common.parallel import cores, run_parts
from common.progress import ProgressBar
from common.text import split_list
from common.vocabulary import Vocabulary
from observer.geometry.views import View, facing, parse_view, split_views
from observer.model.base import MovementModel
from observer.motion.archive import MotionArchive, labels_of, select
from observer.motion.archive_file import read_archive
from observer.motion.label_sets import labels_in
from observer.motion.playback import RecordedMotion
from observer.rendering.scenery import Scenery
from observer.rendering.virtual_camera import PERFECT, VirtualCamera
from observer.runtime.pipeline import Observer
from observer.tracking.camshift import CamshiftTracker
from observer.tracking.skin import SkinHistogram
from observer.tracks import BODY_PARTS, Frame, Tracks
from studies.evaluate import EvaluationResult, TrialResult, evaluate, fuse_again, learn
from studies.report import as_json
from studies.report_text import as_text
from studies.sensors import with_parts
from studies.settings import EvaluationSettings, Progress, folds_of, onset_of, trials_of
from studies.trials import IDLE_NOISE_M, EvaluationTrial

PICTURE_RATE_HZ = 30.0
"""The rate of a camera; resample the archive first: `observer.motion.archive.select(archive, rate_hz=...)`."""
FILM_IDLE_S = 1.5
"""Trembling rest before each recording, in which the tracker finds the person."""
FRONTAL = 0.9
"""A camera that the performer faces less than this (a cosine; 26 degrees) gets the skin learned from the front."""


@dataclass(frozen=True, slots=True)
class Filming:
    """How pictures are rendered. seed: of background, noise and light; the performer's look depends on the name."""

    scenery: Scenery = PERFECT
    size_px: tuple[int, int] = (640, 480)
    seed: int = 0


@dataclass(frozen=True, slots=True)
class RecordedTracks:
    """A tracker that returns tracks made earlier, frame by frame."""

    tracks: Iterator[Tracks]
    body_parts: Sequence[str] = BODY_PARTS

    def update(self, frame: Frame) -> Tracks:
        """The next tracks, whatever the frame."""
        return next(self.tracks)


def track_pictures(trial: EvaluationTrial, view: View, recorded: tuple[str, ...], filming: Filming) -> list[Tracks]:
    """The tracks that camshift finds in pictures of the trial's F frames, after a rest in which it finds the person."""
    still, recording = round(FILM_IDLE_S * trial.recording.rate_hz), trial.recording
    rng = np.random.default_rng([filming.seed, zlib.crc32(trial.name.encode())])
    idle = np.repeat(recording.positions[:1], still, axis=0)
    idle = (idle + rng.normal(0, IDLE_NOISE_M, idle.shape)).astype(np.float32)
    whole = replace(recording, positions=np.concatenate([idle, recording.positions]))
    motion = RecordedMotion(recorded, (whole,), speed=0, clock=lambda: 0)
    camera = VirtualCamera(motion, view, filming.size_px, filming.scenery, filming.seed)
    tracker = CamshiftTracker(_frontal_skin(motion, filming) if facing(view) < FRONTAL else None, facing=facing(view))
    return [tracker.update(frame) for frame in camera.frames(threading.Event())][still:]


def _frontal_skin(motion: RecordedMotion, filming: Filming) -> SkinHistogram | None:
    """The skin histogram that a camera in front learns (`labanmesh camera look --save-skin`)."""
    tracker = CamshiftTracker()
    camera = VirtualCamera(motion, parse_view("door"), filming.size_px, filming.scenery, filming.seed)
    for frame in camera.frames(threading.Event()):
        tracker.update(frame)
        if tracker.skin is not None:
            break
    return tracker.skin


def evaluate_pixels(
    archive: MotionArchive,
    settings: EvaluationSettings,
    filming: Filming | None = None,
    progress: Progress = lambda *_: None,
    processes: int = 2,
) -> EvaluationResult:
    """As `studies.evaluate.evaluate`, with tracks from pictures instead of projected joints.

    Models are learned from the joints. The archive should have PICTURE_RATE_HZ. Raises BadInput as `evaluate` does.
    """
    vocabulary, folds = Vocabulary(settings.labels), folds_of(archive, settings, settings.labels)
    results: list[TrialResult] = []
    for number, split in enumerate(folds):
        trials = trials_of(split, settings, number)
        track = partial(_tracked, views=settings.views, recorded=archive.body_parts, filming=filming or Filming())
        tracked = run_parts(track, trials, processes, partial(progress, "filming and tracking"))
        models = learn(split, vocabulary, settings)
        results += [_judge(*one, models, settings) for one in zip(trials, tracked, strict=True)]
    n_train = sum(len(split.train.recordings) for split in folds)
    return EvaluationResult(settings, vocabulary, fuse_again(results, settings), n_train, 0.0, 0.0)


def _tracked(
    trial: EvaluationTrial, views: tuple[View, ...], recorded: tuple[str, ...], filming: Filming
) -> tuple[list[Tracks], ...]:
    return tuple(track_pictures(trial, view, recorded, filming) for view in views)


def _judge(
    trial: EvaluationTrial,
    tracks: Sequence[Sequence[Tracks]],
    models: Sequence[MovementModel],
    settings: EvaluationSettings,
) -> TrialResult:
    onset = onset_of(trial, settings)
    observers = [Observer(RecordedTracks(iter(t)), model, onset) for t, model in zip(tracks, models, strict=True)]
    interval_ns = 1e9 / trial.recording.rate_hz
    frames = [Frame(round(n * interval_ns), p) for n, p in enumerate(trial.recording.positions)]
    views = np.array([[o.step(frame).p for o in observers] for frame in frames])
    return TrialResult(trial, settings.labels.index(trial.recording.label), views, np.empty((0, 0)))


def from_pixels(
    archive: Annotated[Path, typer.Argument(help="The motion archive (.npz).")],
    views: Annotated[str, typer.Option(help="door, wheel, yaw:DEG[,pitch:DEG]; separated by commas.")],
    labels: Annotated[str, typer.Option(help="Movements, or AS1, AS2, AS3; default: all.")] = "",
    train_subjects: Annotated[str, typer.Option(help="People to learn from; default: every other one.")] = "",
    test_subjects: Annotated[str, typer.Option(help="People to judge; default: those not learned from.")] = "",
    scenery: Annotated[str, typer.Option(help="Behind the person: plain, cluttered or skin_toned.")] = "plain",
) -> None:
    """Judge people from rendered pictures, and from their joints; print both.

    Example: python -m benchmarks.from_pixels msr.npz --views door --scenery cluttered
    """
    filming = Filming(Scenery(background=scenery))
    sampled = with_parts(select(read_archive(archive), rate_hz=PICTURE_RATE_HZ), BODY_PARTS)
    settings = EvaluationSettings(
        tuple(map(parse_view, split_views(views))),
        labels_in(labels) or labels_of(sampled),
        split_list("--train-subjects", train_subjects),
        split_list("--test-subjects", test_subjects),
    )
    with ProgressBar() as bar:
        figures = as_json(evaluate_pixels(sampled, settings, filming, bar, cores()))
        joints = as_json(evaluate(sampled, settings, bar, cores()))["accuracy"]
    loss = f"a loss of {100 * (joints - figures['accuracy']):.1f} points"
    print(f"{as_text(figures)}\n\nfrom pixels, {scenery} background; from the joints {joints:.3f}: {loss}")


if __name__ == "__main__":
    sys.exit(run_command(from_pixels, "from_pixels"))
