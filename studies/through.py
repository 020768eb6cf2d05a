"""`labanmesh evaluate --through`: the same evaluation over real Zenoh sessions, or from rendered pictures."""

import threading
import time
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from threading import Event
from typing import Any

import numpy as np

from common.config import FusionConfig, MeshConfig, ObserverConfig, Scene
from common.errors import LabanmeshError
from common.inbox import Inbox
from common.link import Link
from common.messages import JudgementMessage
from common.vocabulary import Vocabulary
from common.wire import decode
from fusion.engine.engine import FusionEngine
from fusion.service import serve
from observer.geometry.views import View, facing, parse_view
from observer.model.base import MovementModel, Onset
from observer.motion.archive import MotionArchive
from observer.motion.playback import RecordedMotion
from observer.rendering.scenery import Scenery
from observer.rendering.virtual_camera import PERFECT, VirtualCamera
from observer.runtime.pipeline import Observer, Posterior
from observer.runtime.service import PosteriorPublisher
from observer.tracking.camshift import CamshiftTracker
from observer.tracking.skin import SkinHistogram
from observer.tracks import BODY_PARTS, Frame, Tracks
from studies.evaluate import Answer, Floats, Judged, Question, folds_of, learn, refused, trials_of
from studies.trials import IDLE_NOISE_M, Trial

PATIENCE_S = 10.0
AGAIN_S = 0.5
SAME = 1e-6
"""Beliefs no further apart are the same: they travel in single precision."""


@dataclass(frozen=True, slots=True)
class _Court:
    """Everybody who takes part, each on a session of its own."""

    scene: Scene
    vocabulary: Vocabulary
    observers: Sequence[Link]
    heard: Inbox


def fused_over_mesh(answer: Answer, progress: Callable[[str, int, int], None] = lambda *_: None) -> dict[str, Any]:
    """Judge all trials again over the mesh: accuracy, and how many labels are the same as in one process.

    Raises LabanmeshError when a judgement does not come.
    """
    question = answer.question
    ids = [f"view-{v}" for v in range(len(question.views))]
    conduct = FusionConfig(rule=question.rule, fresh_s=PATIENCE_S, drop_s=2 * PATIENCE_S)
    observers = {name: ObserverConfig(source="evaluated") for name in ids}
    scene = Scene(scene="evaluate", mesh=MeshConfig(mode="process"), observers=observers, fusion=conduct)
    stop = threading.Event()
    with Link.open(scene.mesh, "fusion", listen=["tcp/127.0.0.1:0"]) as meeting:
        mesh = scene.mesh.at(meeting.locator)
        referee = FusionEngine(scene.scene, ids, answer.vocabulary, conduct)
        judging = threading.Thread(target=serve, args=(scene, referee, meeting, stop), name="fusion")
        links = [Link.open(mesh, "observer") for _ in ids]
        try:
            with Link.open(mesh, "hub") as ear:
                court = _Court(scene, answer.vocabulary, links, ear.inbox(scene.keys.judgement))
                judging.start()
                labels = [_label(court, j, n, len(answer.judged), progress) for n, j in enumerate(answer.judged)]
        finally:
            stop.set()
            for link in links:
                link.close()
            if judging.ident is not None:
                judging.join()
    return _compared(answer, labels)


def _label(court: _Court, judged: Judged, number: int, total: int, progress: Callable[[str, int, int], None]) -> str:
    """What the referee holds after this trial."""
    keys, last = court.scene.keys, {}
    for v, (name, link) in enumerate(zip(court.scene.roster, court.observers, strict=True)):
        publisher = link.publisher(keys.posterior(name))
        if number == 0 and not publisher.wait_for_subscriber(PATIENCE_S):
            raise LabanmeshError(f"{name} found no referee on the mesh within {PATIENCE_S:g} s")
        speaker = PosteriorPublisher(court.vocabulary, publisher)
        said = [_opinion(judged, v, n) for n in range(len(judged.views))]
        for opinion in said:
            _say(speaker, opinion)
        last[name] = speaker, said[-1]
    progress("judging over the mesh", number + 1, total)
    return _awaited(court, last, judged.trial.name)


def _opinion(judged: Judged, view: int, frame: int) -> Posterior:
    """What one observer believed."""
    facing = None if judged.facing is None else judged.facing[frame, view]
    unlearned = np.nan if judged.unlearned is None else float(judged.unlearned[frame, view])
    p = judged.views[frame, view]
    return Posterior(p, 0.0, frame + 1, {}, facing=facing, unlearned=None if np.isnan(unlearned) else unlearned)


def _say(speaker: PosteriorPublisher, opinion: Posterior) -> None:
    now_ns = time.time_ns()
    speaker.publish(opinion, now_ns, now_ns)


def _awaited(court: _Court, last: Mapping[str, tuple[PosteriorPublisher, Posterior]], trial: str) -> str:
    """The label of the first judgement in which everybody's last posterior counts."""
    begun = said = time.monotonic()
    while (now := time.monotonic()) < begun + PATIENCE_S:
        for arrival in court.heard.take(AGAIN_S):
            judgement = decode(JudgementMessage, arrival.payload)
            if all(_says(judgement, name, opinion.p) for name, (_, opinion) in last.items()):
                return judgement.label
        if now > said + AGAIN_S:
            # Zenoh drops what floods it: what was said last may have been lost, and is said again.
            said = now
            for speaker, opinion in last.values():
                _say(speaker, opinion)
    raise LabanmeshError(f"no judgement of {trial} came over the mesh within {PATIENCE_S:g} s")


def _says(judgement: JudgementMessage, observer: str, p: Floats) -> bool:
    vote = judgement.votes.get(observer)
    return vote is not None and vote.p is not None and bool(np.abs(np.array(vote.p) - p).max() < SAME)


def _compared(answer: Answer, labels: Sequence[str]) -> dict[str, Any]:
    names = answer.vocabulary.labels
    here = [names[int(j.fused[-1].argmax())] for j in answer.judged]
    true = [names[j.truth] for j in answer.judged]
    return {
        "accuracy": sum(a == b for a, b in zip(labels, true, strict=True)) / max(len(labels), 1),
        "same_labels": sum(a == b for a, b in zip(labels, here, strict=True)),
        "n": len(labels),
        "labels": list(labels),
    }


RATE_HZ = 30.0
"""What cameras give: bring the archive to it first, `observer.motion.transforms.select(archive, rate_hz=RATE_HZ)`."""
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
