"""`labanmesh evaluate --through pixels`: recorded people are filmed, tracked and judged: what does a picture cost?"""

import zlib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from threading import Event

import numpy as np

from common.vocabulary import Vocabulary
from observer.geometry.views import View, facing, parse_view
from observer.model.base import MovementModel, Onset
from observer.motion.archive import MotionArchive
from observer.pipeline import Observer
from observer.rendering.scenery import Scenery
from observer.rendering.virtual_camera import PERFECT, VirtualCamera
from observer.source import RecordedMotion
from observer.tracking.camshift import CamshiftTracker
from observer.tracking.skin import SkinHistogram
from observer.tracks import BODY_PARTS, Frame, Tracks
from studies.evaluate import Answer, Judged, Question, folds_of, learn, refused, trials_of
from studies.trials import IDLE_NOISE_M, Trial

RATE_HZ = 30.0
"""What cameras give: bring the archive to it first, `observer.learning.prepared(archive, rate_hz=RATE_HZ)`."""
IDLE_S = 1.5
"""So long the performer stands, trembling, before a recording begins: no camera is switched on by a gesture."""
FRONTAL = 0.9
"""A camera whom the performer faces less than this (26 degrees) is given the skin that one in front has learned."""
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True)
class Filming:
    """How the pictures are made. seed: of background, noise and light; the performer's look follows from his name."""

    scenery: Scenery = PERFECT
    size_px: tuple[int, int] = (640, 480)
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Given:
    """A tracker of tracks that are known already, frame by frame."""

    tracks: Iterator[Tracks]
    body_parts: Sequence[str] = BODY_PARTS

    def update(self, frame: Frame) -> Tracks:
        """The next ones, whatever the frame."""
        return next(self.tracks)


def tracked(trial: Trial, view: View, recorded: tuple[str, ...], filming: Filming) -> list[Tracks]:
    """The trial's F frames as the camshift tracker sees them in pictures, who has seen him stand before."""
    still, recording = round(IDLE_S * trial.recording.rate_hz), trial.recording
    rng = np.random.default_rng([filming.seed, zlib.crc32(trial.name.encode())])
    idle = np.repeat(recording.positions[:1], still, axis=0)
    idle = (idle + rng.normal(0, IDLE_NOISE_M, idle.shape)).astype(np.float32)
    whole = replace(recording, positions=np.concatenate([idle, recording.positions]))
    motion = RecordedMotion(recorded, (whole,), speed=0, clock=lambda: 0)
    camera = VirtualCamera(motion, view, filming.size_px, filming.scenery, filming.seed)
    tracker = CamshiftTracker(_introduced(motion, filming) if facing(view) < FRONTAL else None, facing=facing(view))
    return [tracker.update(frame) for frame in camera.frames(Event())][still:]


def _introduced(motion: RecordedMotion, filming: Filming) -> SkinHistogram | None:
    """The skin that a camera in front learns and saves for one that sees no face (`labanmesh look --save-skin`)."""
    tracker = CamshiftTracker()
    camera = VirtualCamera(motion, parse_view("door"), filming.size_px, filming.scenery, filming.seed)
    for frame in camera.frames(Event()):
        tracker.update(frame)
        if tracker.skin is not None:
            break
    return tracker.skin


def evaluate_pixels(
    archive: MotionArchive,
    question: Question,
    filming: Filming | None = None,
    progress: Progress = lambda *_: None,
    processes: int = 2,
) -> Answer:
    """What `studies.evaluate.evaluate` answers, with tracks from pictures in place of projected joints.

    Models are learned from the joints, as ever; trials, onset and rule are those of the question. The archive is best
    at RATE_HZ. Raises BadInput as `evaluate` does.
    """
    vocabulary, folds = Vocabulary(question.labels), folds_of(archive, question, question.labels)
    judged: list[Judged] = []
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        for number, split in enumerate(folds):
            part = trials_of(split, question, number)
            see = partial(_seen, views=question.views, recorded=archive.body_parts, filming=filming or Filming())
            models = learn(split, vocabulary, question)
            for n, (trial, seen) in enumerate(zip(part, pool.map(see, part), strict=True)):
                judged.append(_judge(trial, seen, models, question))
                progress("filming, tracking and judging", n + 1, len(part))
    n_train = sum(len(split.train.recordings) for split in folds)
    return Answer(question, vocabulary, refused(judged, question, vocabulary), n_train, 0.0, 0.0)


def _seen(
    trial: Trial, views: tuple[View, ...], recorded: tuple[str, ...], filming: Filming
) -> tuple[list[Tracks], ...]:
    return tuple(tracked(trial, view, recorded, filming) for view in views)


def _judge(
    trial: Trial, seen: Sequence[Sequence[Tracks]], models: Sequence[MovementModel], question: Question
) -> Judged:
    onset = Onset(known=True, length=len(trial.recording.positions)) if question.onset_known else Onset()
    observers = [Observer(Given(iter(tracks)), model, onset) for tracks, model in zip(seen, models, strict=True)]
    interval_ns = 1e9 / trial.recording.rate_hz
    frames = [Frame(round(n * interval_ns), p) for n, p in enumerate(trial.recording.positions)]
    views = np.array([[o.step(frame).p for o in observers] for frame in frames])
    return Judged(trial, question.labels.index(trial.recording.label), views, np.empty((0, 0)))
