"""Adapts a tracker to a model and to the camera file of its view. Pure."""

from collections.abc import Sequence

import numpy as np

from common.errors import BadInput
from observer.camera.base import size_of
from observer.geometry.picture_size import picture_scale
from observer.geometry.views import View
from observer.tracks import Floats, Frame, Tracker, Tracks

NEVER_SEEN = np.full((1, 2), np.nan)


class PreparedTracker:
    """Adapts a tracker to a model: selects the wanted body parts, in their order, and brings the centres to its view.

    view: of a calibrated camera, with the size of its pictures, to which centres are scaled, and its lens, whose
    distortion is removed, because the projective matrix is valid for undistorted pixels of that size; None: neither.
    fewer_parts: a part that the tracker does not find is never seen. Raises BadInput if it does not find a wanted part,
    or none of them.
    """

    def __init__(
        self,
        tracker: Tracker,
        wanted: Sequence[str],
        view: View | None = None,
        fewer_parts: bool = False,
    ) -> None:
        known = list(tracker.body_parts)
        self.lacking = tuple(part for part in wanted if part not in known)
        """Wanted parts that the tracker does not find."""
        if self.lacking and not (fewer_parts and len(self.lacking) < len(wanted)):
            raise BadInput(lacking_parts(self.lacking, known))
        self.body_parts = tuple(wanted)
        self.tracker = tracker
        # One row more, which is never seen, stands for the parts that the tracker does not find.
        self._rows = [known.index(part) if part in known else len(known) for part in wanted]
        self._view = view
        self.picture_tracks: Tracks | None = None
        self.all_tracks: Tracks | None = None
        """The tracker's own rows, of all its body parts, in px of the picture."""

    def of_parts(self, wanted: Sequence[str]) -> "PreparedTracker":
        """The same tracker for other body parts; raises BadInput if it does not find one of them."""
        return PreparedTracker(self.tracker, wanted, self._view)

    @property
    def complaint(self) -> str:
        """Why the tracker finds little in the pictures, and what to do about it; "" if all is well."""
        return str(getattr(self.tracker, "complaint", ""))

    def update(self, frame: Frame) -> Tracks:
        """Undistorted tracks (P, 2); those in px of the picture, to draw on it, are left in `picture_tracks`.

        Raises BadInput for pictures of another shape than the camera file's.
        """
        tracks = self.all_tracks = self.tracker.update(frame)
        guesses = None if tracks.guesses is None else self._wanted(tracks.guesses)
        self.picture_tracks = Tracks(self._wanted(tracks.centres), guesses, tracks.people)
        if self._view is None or (self._view.lens is None and self._view.size_px is None):
            return self.picture_tracks
        scale = picture_scale(self._view, size_of(frame.content)) if frame.content.dtype == np.uint8 else 1.0
        calibrated = None if guesses is None else self._calibrated(guesses, scale)
        return Tracks(self._calibrated(self.picture_tracks.centres, scale), calibrated, tracks.people)

    def _calibrated(self, centres: Floats, scale: float) -> Floats:
        """(P, 2) px of the picture -> undistorted px of the camera file."""
        lens = self._view.lens if self._view else None
        return centres * scale if lens is None else lens.undistorted(centres * scale)

    def _wanted(self, rows: Floats) -> Floats:
        wanted: Floats = (np.concatenate([rows, NEVER_SEEN]) if self.lacking else rows)[self._rows]
        return wanted


def lacking_parts(lacking: Sequence[str], found: Sequence[str]) -> str:
    """One line: a model reads parts that the tracker does not find, and what to do."""
    return (
        f"body part {lacking[0]!r}: the model reads it, the tracker finds {', '.join(found)}; use a tracker with a "
        f'pose model (tracker = "mediapipe"), or learn the model with --body-parts {",".join(found)}'
    )
