"""One observer, from a frame to its opinion. No network and no clock inside."""

from collections.abc import Mapping
from dataclasses import dataclass

from common.vocabulary import Vocabulary
from observer.model.base import MovementModel, Onset
from observer.tracks import Floats, Frame, Tracker


@dataclass(frozen=True, slots=True)
class Opinion:
    """What an observer believes after a frame.

    p: (M,) posterior over the vocabulary. rest: probability that the person is at rest. frames: how many are in it.
    visible: per body part, whether it was seen in the newest frame.
    """

    p: Floats
    rest: float
    frames: int
    visible: Mapping[str, bool]


class Observer:
    """Tracks, reads and believes: `step` is steps 3 to 6 of a frame's way (docs/frame.md)."""

    def __init__(self, tracker: Tracker, model: MovementModel, onset: Onset | None = None) -> None:
        self._tracker = tracker
        self._watch = model.watch(onset or Onset())
        self.vocabulary: Vocabulary = model.header.vocabulary
        self._frames = 0

    def step(self, frame: Frame) -> Opinion:
        """One frame at the model's rate."""
        tracks = self._tracker.update(frame)
        self._watch.update(tracks)
        self._frames += 1
        visible = dict(zip(self._tracker.body_parts, tracks.visible.tolist(), strict=True))
        return Opinion(self._watch.p, self._watch.rest, self._frames, visible)
