"""A person who moves and rests, and what four judges output about each frame. `meet` is a real person of MSR Action3D
where LABANMESH_DATA names the recordings, else the synthetic performer, seen by four observers that learned from
others. `scripted` costs nothing: posteriors that grow sure while somebody moves."""

import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from common.vocabulary import Vocabulary, agreed_times
from observer.geometry.views import parse_view
from observer.learning.learn import learn_view
from observer.model.base import Onset
from observer.model.registry import DEFAULT_MODEL
from observer.motion.archive import MotionArchive, Recording, Span
from observer.motion.importers import import_recordings
from observer.motion.projected import ProjectedTracker
from observer.runtime.pipeline import Observer
from observer.tracks import BODY_PARTS, Tracks
from studies.observing import OutputCourse, watch
from studies.performer import perform, perform_continuously
from studies.sensors import with_parts
from studies.trials import strung, with_labels

VIEWS = {"door": "door", "corner": "yaw:45", "side": "yaw:-45", "wheel": "wheel"}
RECORDED = ("high_arm_wave", "hand_clap", "two_hand_wave", "draw_x")
PERFORMED = ("lunging", "byebye", "nthrow", "stretch")
TEACHERS = ("1", "3", "5", "7", "9")
STUDENT = os.environ.get("LABANMESH_ATTACKS_PERSON", "2")
"""Who is judged, by four observers that learned from four teachers: development people are the teachers themselves."""
SEED = 17
RATE_HZ = 15.0
SETTLE = 8
"""Frames until a scripted judge is sure."""


@dataclass
class Person:
    """A stream of movements with rest in between, and by view a model; scripted: what the judges output."""

    stream: Recording
    vocabulary: Vocabulary
    models: dict = field(default_factory=dict)
    body_parts: tuple = ()
    scripted: dict = field(default_factory=dict)
    _seen: dict = field(default_factory=dict)

    @property
    def spans(self):
        """What is done, and when, in frames."""
        return self.stream.spans

    def courses(self):
        """By judge its output in each frame, an OutputCourse."""
        return {name: self.course(name) for name in VIEWS}

    def course(self, name, blind=False):
        """What one judge outputs; blind: something stands before its camera."""
        if (name, blind) not in self._seen:
            self._seen[name, blind] = self._watch(name, blind)
        return self._seen[name, blind]

    def _watch(self, name, blind):
        if self.scripted:
            return unseeing(self.scripted[name]) if blind else self.scripted[name]
        model = self.models[name]
        tracker = ProjectedTracker(parse_view(VIEWS[name]), self.body_parts, model.header.body_parts)
        return watch(Observer(CoveredTracker(tracker.body_parts) if blind else tracker, model, Onset()), self.stream)


class CoveredTracker:
    """Sees no body part in any frame."""

    def __init__(self, body_parts):
        self.body_parts = body_parts

    def update(self, frame):
        """All parts missing."""
        return Tracks(np.full((len(self.body_parts), 2), np.nan))


def meet(folder=None, kind=DEFAULT_MODEL):
    """The person whom real observers see."""
    place = folder or os.environ.get("LABANMESH_DATA")
    if place:
        labels = RECORDED
        archive = with_parts(import_recordings("msr-action3d", Path(place) / "msr_action3d").archive, BODY_PARTS)
        known = with_labels(archive, labels)
        teachers = [teacher for teacher in TEACHERS if teacher != STUDENT][:4]
        learned = MotionArchive(known.body_parts, tuple(r for r in known.recordings if r.subject in teachers))
        own = [r for r in known.recordings if r.subject == STUDENT]
        (stream,) = strung(own, np.random.default_rng(SEED))
    else:
        labels, learned = PERFORMED, perform(("2", "3", "4"), PERFORMED, trials=2)
        stream = perform_continuously("1", PERFORMED, rest_s=(1.5, 2.0))
    vocabulary = Vocabulary(labels)
    models = {name: learn_view(learned, parse_view(view), vocabulary, kind=kind) for name, view in VIEWS.items()}
    # As a fusion service has them.
    times = agreed_times([model.header.vocabulary for model in models.values()])
    return Person(stream, Vocabulary(labels, movements=times), models, learned.body_parts)


def scripted(movements=8, moving_s=1.5, rest_s=1.5):
    """Somebody who does so many movements; each judge grows sure of the right one, a little unlike the others."""
    labels, rng = PERFORMED, np.random.default_rng(SEED)
    rest, moving = round(rest_s * RATE_HZ), round(moving_s * RATE_HZ)
    frames = rest + movements * (rest + moving)
    begins = [rest + n * (rest + moving) for n in range(movements)]
    spans = tuple(Span(at, at + moving, labels[n % len(labels)]) for n, at in enumerate(begins))
    stream = Recording(np.zeros((frames, 1, 3), np.float32), RATE_HZ, "", "nobody", "scripted", spans)
    courses = {name: _scripted_course(frames, spans, labels, rng) for name in VIEWS}
    return Person(stream, Vocabulary(labels), scripted=courses)


def _scripted_course(frames, spans, labels, rng):
    p, rest = np.full((frames, len(labels)), 1 / len(labels)), np.full(frames, 0.97)
    for span in spans:
        for frame in range(span.start, span.end):
            sure = min((frame - span.start) / SETTLE, 1.0) * rng.uniform(0.85, 0.97)
            p[frame] = (1 - sure) / len(labels)
            p[frame, labels.index(span.label)] += sure
            rest[frame] = 0.05
    return OutputCourse(p, rest, np.ones(frames, bool), np.full(frames, np.nan))


def unseeing(course):
    """A judge that sees nobody: uniform, and at rest."""
    frames, movements = course.p.shape
    return OutputCourse(
        np.full((frames, movements), 1 / movements), np.ones(frames), np.zeros(frames, bool), course.unlearned
    )
