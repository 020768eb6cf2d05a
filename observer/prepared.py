"""Between camera, tracker and model: pictures mirrored back, centres undistorted, parts in the model's order."""

import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from common.errors import BadInput
from observer.geometry.lens import LensDistortion
from observer.source import FrameSource
from observer.tracks import Floats, Frame, Tracker, Tracks


@dataclass(frozen=True, slots=True)
class Unmirrored:
    """A source of pictures that are mirror images, as selfies are: right is right again."""

    mirrored: FrameSource

    @property
    def rate_hz(self) -> float:
        """As the mirrored ones."""
        return self.mirrored.rate_hz

    @property
    def body_parts(self) -> Sequence[str]:
        """As the mirrored ones."""
        return self.mirrored.body_parts

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """The same frames, each turned about its vertical middle."""
        for frame in self.mirrored.frames(stop):
            # A copy, because OpenCV wants rows that run to the right in memory too.
            yield replace(frame, content=np.ascontiguousarray(frame.content[:, ::-1]))


class PreparedTracker:
    """A tracker as a model wants it: the wanted parts in their order, and straight lines straight.

    lens: of a calibrated camera, whose projective matrix holds for undistorted pixels only; None: nothing to undo.
    Raises BadInput when the tracker does not find a wanted part.
    """

    def __init__(self, tracker: Tracker, wanted: Sequence[str], lens: LensDistortion | None = None) -> None:
        known = list(tracker.body_parts)
        missing = [part for part in wanted if part not in known]
        if missing:
            raise BadInput(f"body part {missing[0]!r}: the model reads it, the tracker finds {', '.join(known)}")
        self.body_parts = tuple(wanted)
        self.tracker = tracker
        self._rows, self._lens = [known.index(part) for part in wanted], lens
        self.found: Tracks | None = None

    @property
    def complaint(self) -> str:
        """Why little can be made out in the pictures, and what to do; "" when all is well."""
        return str(getattr(self.tracker, "complaint", ""))

    def update(self, frame: Frame) -> Tracks:
        """Undistorted tracks (P, 2); those of the picture itself, for who draws on it, are left in `found`."""
        tracks = self.tracker.update(frame)
        guesses = None if tracks.guesses is None else tracks.guesses[self._rows]
        self.found = Tracks(tracks.centres[self._rows], guesses)
        if self._lens is None:
            return self.found
        return Tracks(self._straight(self.found.centres), None if guesses is None else self._straight(guesses))

    def _straight(self, centres: Floats) -> Floats:
        return centres if self._lens is None else self._lens.undistorted(centres)
