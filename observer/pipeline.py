"""One observer, from a frame to its opinion. No network and no clock inside."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from common.vocabulary import Vocabulary
from observer.effort.reader import FacetReader
from observer.model.answers import believed
from observer.model.base import MovementModel, Onset
from observer.pace import Pace
from observer.tracks import Floats, Frame, Tracker, Tracks

SMALLEST = 1e-300
"""Stands for 0 where it divides."""


@dataclass(frozen=True, slots=True)
class Opinion:
    """What an observer believes after a frame.

    p: (M,) posterior over the vocabulary. rest: probability that the person is at rest. frames: how many are in it.
    visible: per body part, whether it was seen in the newest frame. facets: of common.facets, those that can be said.
    facing: (M, K) P(facing | movement), None of a model that knows one alone. unlearned: probability that what is done
    is none of the vocabulary's movements, None where that cannot be told.
    """

    p: Floats
    rest: float
    frames: int
    visible: Mapping[str, bool]
    facets: Mapping[str, Floats] = field(default_factory=dict)
    facing: Floats | None = None
    unlearned: float | None = None


class Observer:
    """Tracks, reads and believes: `step` is steps 3 to 6 of a frame's way (docs/design/frame.md).

    pace: brings the frames to the model's rate; None: they come at it. facets: reads Effort and Shape at that rate.
    """

    def __init__(
        self,
        tracker: Tracker,
        model: MovementModel,
        onset: Onset | None = None,
        pace: Pace | None = None,
        facets: FacetReader | None = None,
    ) -> None:
        self._tracker, self._pace, self._facets = tracker, pace, facets
        self._watch = model.watch(onset or Onset())
        self._certainty = model.header.certainty
        self.vocabulary: Vocabulary = model.header.vocabulary
        self._frames = 0
        self.tracks: Tracks | None = None

    @property
    def complaint(self) -> str:
        """Why the tracker makes out little in the pictures, and what to do; "" when all is well."""
        return str(getattr(self._tracker, "complaint", ""))

    def step(self, frame: Frame) -> Opinion:
        """One frame, as it comes; while no instant of the model is due the belief stays. Leaves `tracks`."""
        self.tracks = self._tracker.update(frame)
        instants = [self.tracks] if self._pace is None else self._pace.due(frame.at_ns, self.tracks)
        for tracks in instants:
            self._watch.update(tracks)
            if self._facets is not None:
                self._facets.update(tracks, self._watch.rest)
        self._frames += len(instants)
        visible = dict(zip(self._tracker.body_parts, self.tracks.visible.tolist(), strict=True))
        facets = {} if self._facets is None else self._facets.facets
        learned, unlearned = believed(self._watch, self._certainty)
        p: Floats = learned.sum(axis=1)
        facing = None if learned.shape[1] == 1 else learned / np.maximum(p, SMALLEST)[:, None]
        return Opinion(p, self._watch.rest, self._frames, visible, facets, facing, unlearned)
