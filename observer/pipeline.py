"""One observer, from a frame to its opinion. No network and no clock inside."""

from collections.abc import Mapping
from dataclasses import dataclass

from common.vocabulary import Vocabulary
from observer.model.base import MovementModel, Onset
from observer.pace import Pace
from observer.tracks import Floats, Frame, Tracker, Tracks


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
    """Tracks, reads and believes: `step` is steps 3 to 6 of a frame's way (docs/frame.md).

    pace: brings the frames to the model's rate; None: they come at it.
    """

    def __init__(
        self, tracker: Tracker, model: MovementModel, onset: Onset | None = None, pace: Pace | None = None
    ) -> None:
        self._tracker, self._pace = tracker, pace
        self._watch = model.watch(onset or Onset())
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
        self._frames += len(instants)
        visible = dict(zip(self._tracker.body_parts, self.tracks.visible.tolist(), strict=True))
        return Opinion(self._watch.p, self._watch.rest, self._frames, visible)
