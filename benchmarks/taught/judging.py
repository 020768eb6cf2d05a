"""One take after another, as several observers with taught models see it: verdicts as the fusion service gives them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from common.config_sections import FusionConfig, default_quorum
from common.vocabulary import ABSTAIN, Vocabulary
from observer.learning.learn import learn_view
from observer.model.base import MovementModel, Onset
from observer.motion.archive import MotionArchive, Recording
from observer.motion.projected import ProjectedTracker, view_of
from observer.runtime.pipeline import Observer
from studies.observing import watch
from studies.spotting import StreamVerdict
from studies.stream import judged_stream, observed_stream

Cameras = Mapping[str, MotionArchive]
"""Name of each camera -> its tracks; the same performances have the same label, subject and trial."""


@dataclass(frozen=True, slots=True)
class TaughtModels:
    """How models are learned: the kind, its parameters, and what else people do, by camera (none: empty)."""

    kind: str
    parameters: Mapping[str, float] = field(default_factory=dict)
    life: Cameras = field(default_factory=dict)

    def models(self, cameras: Cameras, labels: Sequence[str]) -> dict[str, MovementModel]:
        """The model of each camera, from all of its takes."""
        return {
            name: learn_view(
                archive,
                view_of(archive, ""),
                Vocabulary(tuple(labels)),
                kind=self.kind,
                parameters=self.parameters,
                background=self.life.get(name),
            )
            for name, archive in cameras.items()
        }


def verdicts_on(
    streams: Mapping[str, Recording], body_parts: Sequence[str], models: Mapping[str, MovementModel]
) -> list[StreamVerdict]:
    """The verdicts on one performance, of which each camera has its own tracks, by fusion with its defaults."""
    courses = []
    for name, stream in streams.items():
        model = models[name]
        tracker = ProjectedTracker(view_of(MotionArchive((), ()), "camera"), body_parts, model.header.body_parts)
        courses.append(watch(Observer(tracker, model, Onset()), stream))
    longest = max(len(stream.positions) for stream in streams.values())
    courses = [course.at(np.minimum(np.arange(longest), len(course.p) - 1)) for course in courses]
    first = next(iter(streams.values()))
    vocabulary = next(iter(models.values())).header.vocabulary
    whole = replace(first, positions=np.empty((longest, 1, 2), np.float32))
    fusion = FusionConfig(quorum=default_quorum(len(streams)))
    return list(judged_stream(observed_stream(whole, courses, vocabulary), fusion).verdicts)


def names_in(verdicts: Sequence[StreamVerdict]) -> list[str]:
    """The first label of each verdict that names a movement."""
    return [verdict.label for verdict in verdicts if verdict.label != ABSTAIN]
