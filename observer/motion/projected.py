"""Recorded motion as a view sees it: a projective matrix replaces the camera and its tracker."""

from collections.abc import Iterator, Sequence

import numpy as np

from common import SECOND_NS
from common.errors import BadInput
from observer.geometry.projection import project
from observer.geometry.views import View
from observer.motion.archive import Recording
from observer.tracks import Frame, Tracks


class ProjectedTracker:
    """A tracker that projects the 3-D positions of a frame into a view (section II.B).

    recorded: names of the parts in the frame's content; wanted: those that the model reads, in its order.
    Raises BadInput if a wanted part was not recorded.
    """

    def __init__(self, view: View, recorded: Sequence[str], wanted: Sequence[str]) -> None:
        self.body_parts = tuple(wanted)
        self._view = view
        self._rows = _rows_of(wanted, recorded)

    def update(self, frame: Frame) -> Tracks:
        """The recorded positions in the view's image; a part that is missing in this frame is not seen."""
        return Tracks(project(self._view.matrix, frame.content[self._rows]))


def view_tracks(view: View, recording: Recording, recorded: tuple[str, ...], wanted: tuple[str, ...]) -> list[Tracks]:
    """The tracks of all frames of a recording, seen from the view, as a `ProjectedTracker` finds them, but faster."""
    positions = recording.positions[:, _rows_of(wanted, recorded)].astype(np.float64)
    return [Tracks(centres) for centres in project(view.matrix, positions)]


def _rows_of(wanted: Sequence[str], recorded: Sequence[str]) -> list[int]:
    missing = [part for part in wanted if part not in recorded]
    if missing:
        raise BadInput(f"body part {missing[0]!r}: not in the recording; it has {', '.join(recorded)}")
    return [list(recorded).index(part) for part in wanted]


def frames_of(recording: Recording, start_ns: int = 0) -> Iterator[Frame]:
    """The recording's frames, captured at its own rate from `start_ns` on."""
    interval_ns = SECOND_NS / recording.rate_hz
    for n, positions in enumerate(recording.positions.astype(np.float64)):
        yield Frame(start_ns + round(n * interval_ns), positions)
