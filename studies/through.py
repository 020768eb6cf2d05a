"""`labanmesh evaluate --through`: the same evaluation over real Zenoh sessions, or from rendered pictures.

mesh: every view publishes in a session of its own, the fusion service runs in another, and a third session subscribes
to the judgements. Only the wire differs from the evaluation in one process.
pixels: virtual cameras film the recorded people, and camshift tracks hands and head in the pictures.
"""

import threading
import time
import zlib
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from typing import Any

import numpy as np

from common.config import FusionConfig, MeshConfig, ObserverConfig, Scene
from common.errors import LabanmeshError
from common.inbox import Inbox
from common.link import Link
from common.messages import JudgementMessage
from common.vocabulary import Vocabulary
from common.wire import decode
from fusion.server import serve
from observer.geometry.views import View, facing, parse_view
from observer.model.base import MovementModel
from observer.motion.archive import MotionArchive
from observer.motion.playback import RecordedMotion
from observer.rendering.scenery import Scenery
from observer.rendering.virtual_camera import PERFECT, VirtualCamera
from observer.runtime.pipeline import Observer, Posterior
from observer.runtime.service import PosteriorPublisher
from observer.tracking.camshift import CamshiftTracker
from observer.tracking.skin import SkinHistogram
from observer.tracks import BODY_PARTS, Floats, Frame, Tracks
from studies.evaluate import (
    EvaluationResult,
    EvaluationSettings,
    Progress,
    TrialResult,
    folds_of,
    fuse_again,
    learn,
    onset_of,
    trials_of,
)
from studies.trials import IDLE_NOISE_M, EvaluationTrial

TIMEOUT_S = 10.0
REPEAT_S = 0.5
TOLERANCE = 1e-6
"""Posteriors that differ by less are equal: they travel in single precision."""


@dataclass(frozen=True, slots=True)
class _MeshRun:
    """The sessions of the observers, and the judgements that the subscriber receives."""

    scene: Scene
    vocabulary: Vocabulary
    observers: Sequence[Link]
    judgements: Inbox


def fused_over_mesh(result: EvaluationResult, progress: Progress = lambda *_: None) -> dict[str, Any]:
    """Judge all trials again over the mesh: accuracy, and how many labels equal those of one process.

    Raises LabanmeshError when a judgement does not arrive.
    """
    ids = [f"view-{v}" for v in range(len(result.settings.views))]
    config = FusionConfig(rule=result.settings.rule, fresh_s=TIMEOUT_S, drop_s=2 * TIMEOUT_S)
    observers = {name: ObserverConfig(source="evaluated") for name in ids}
    vocabulary = result.vocabulary
    scene = Scene(
        scene="evaluate",
        vocabulary=vocabulary.labels,
        vocabulary_name=vocabulary.name,
        mesh=MeshConfig(mode="process"),
        observers=observers,
        fusion=config,
    )
    stop = threading.Event()
    with Link.open(scene.mesh, "fusion", listen=["tcp/127.0.0.1:0"]) as fusion:
        mesh = scene.mesh.at(fusion.locator)
        thread = threading.Thread(target=serve, args=([scene], config.id, fusion, stop), name="fusion")
        links = [Link.open(mesh, "observer") for _ in ids]
        try:
            with Link.open(mesh, "hub") as hub:
                run = _MeshRun(scene, result.vocabulary, links, hub.inbox(scene.keys.votes))
                thread.start()
                labels = [_label(run, r, n, len(result.trials), progress) for n, r in enumerate(result.trials)]
        finally:
            stop.set()
            for link in links:
                link.close()
            if thread.ident is not None:
                thread.join()
    return _compared(result, labels)


def _label(run: _MeshRun, result: TrialResult, number: int, total: int, progress: Progress) -> str:
    """Publish one trial; the label of the judgement after its last frame."""
    last = {}
    for v, (name, link) in enumerate(zip(run.scene.roster, run.observers, strict=True)):
        publisher = link.publisher(run.scene.keys.posterior(name))
        if number == 0 and not publisher.wait_for_subscriber(TIMEOUT_S):
            raise LabanmeshError(f"{name} found no fusion service on the mesh within {TIMEOUT_S:g} s")
        sender = PosteriorPublisher(run.vocabulary, publisher)
        posteriors = [_posterior(result, v, n) for n in range(len(result.views))]
        for posterior in posteriors:
            _publish(sender, posterior)
        last[name] = sender, posteriors[-1]
    progress("judging over the mesh", number + 1, total)
    return _awaited(run, last, result.trial.name)


def _posterior(result: TrialResult, view: int, frame: int) -> Posterior:
    facing = None if result.facing is None else result.facing[frame, view]
    unlearned = np.nan if result.unlearned is None else float(result.unlearned[frame, view])
    p = result.views[frame, view]
    return Posterior(p, 0.0, frame + 1, {}, facing=facing, unlearned=None if np.isnan(unlearned) else unlearned)


def _publish(sender: PosteriorPublisher, posterior: Posterior) -> None:
    now_ns = time.time_ns()
    sender.publish(posterior, now_ns, now_ns)


def _awaited(run: _MeshRun, last: Mapping[str, tuple[PosteriorPublisher, Posterior]], trial: str) -> str:
    """The label of the first judgement in which the last posterior of every observer counts."""
    begun = sent = time.monotonic()
    while (now := time.monotonic()) < begun + TIMEOUT_S:
        for arrival in run.judgements.take(REPEAT_S):
            judgement = decode(JudgementMessage, arrival.payload)
            if all(_counts(judgement, name, posterior.p) for name, (_, posterior) in last.items()):
                return judgement.label
        if now > sent + REPEAT_S:
            # Zenoh drops messages under load: the last posteriors may have been lost, so they are sent again.
            sent = now
            for sender, posterior in last.values():
                _publish(sender, posterior)
    raise LabanmeshError(f"no judgement of {trial} arrived over the mesh within {TIMEOUT_S:g} s")


def _counts(judgement: JudgementMessage, observer: str, p: Floats) -> bool:
    vote = judgement.votes.get(observer)
    return vote is not None and vote.p is not None and bool(np.abs(np.array(vote.p) - p).max() < TOLERANCE)


def _compared(result: EvaluationResult, labels: Sequence[str]) -> dict[str, Any]:
    names = result.vocabulary.labels
    here = [names[int(r.fused[-1].argmax())] for r in result.trials]
    true = [names[r.truth] for r in result.trials]
    return {
        "accuracy": sum(a == b for a, b in zip(labels, true, strict=True)) / max(len(labels), 1),
        "same_labels": sum(a == b for a, b in zip(labels, here, strict=True)),
        "n": len(labels),
        "labels": list(labels),
    }


RATE_HZ = 30.0
"""The rate of a camera; resample the archive first: `observer.motion.archive.select(archive, rate_hz=RATE_HZ)`."""
IDLE_S = 1.5
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
    still, recording = round(IDLE_S * trial.recording.rate_hz), trial.recording
    rng = np.random.default_rng([filming.seed, zlib.crc32(trial.name.encode())])
    idle = np.repeat(recording.positions[:1], still, axis=0)
    idle = (idle + rng.normal(0, IDLE_NOISE_M, idle.shape)).astype(np.float32)
    whole = replace(recording, positions=np.concatenate([idle, recording.positions]))
    motion = RecordedMotion(recorded, (whole,), speed=0, clock=lambda: 0)
    camera = VirtualCamera(motion, view, filming.size_px, filming.scenery, filming.seed)
    tracker = CamshiftTracker(_frontal_skin(motion, filming) if facing(view) < FRONTAL else None, facing=facing(view))
    return [tracker.update(frame) for frame in camera.frames(threading.Event())][still:]


def _frontal_skin(motion: RecordedMotion, filming: Filming) -> SkinHistogram | None:
    """The skin histogram that a camera in front learns (`labanmesh look --save-skin`)."""
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

    Models are learned from the joints. The archive should have RATE_HZ. Raises BadInput as `evaluate` does.
    """
    vocabulary, folds = Vocabulary(settings.labels), folds_of(archive, settings, settings.labels)
    results: list[TrialResult] = []
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        for number, split in enumerate(folds):
            trials = trials_of(split, settings, number)
            track = partial(_tracked, views=settings.views, recorded=archive.body_parts, filming=filming or Filming())
            models = learn(split, vocabulary, settings)
            for n, (trial, tracks) in enumerate(zip(trials, pool.map(track, trials), strict=True), 1):
                results.append(_judge(trial, tracks, models, settings))
                progress("filming, tracking and judging", n, len(trials))
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
