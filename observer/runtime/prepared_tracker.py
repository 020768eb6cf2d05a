"""Adapts a tracker to a model and to the camera file of its view, and lets it rest. Pure."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from common.errors import BadInput
from observer.geometry.views import View, picture_scale, scale_note
from observer.tracks import Floats, Frame, PersonTracks, Size, Tracker, Tracks, size_of

NEVER_SEEN = np.full((1, 2), np.nan)
RESTING_RUNS = 4
"""While nothing changes, tracks are the mean of so many runs: the parts stay, only the tracker trembles."""


class PreparedTracker:
    """Adapts a tracker to a model: selects the wanted body parts, in their order, and brings the centres to its view.

    view: of a calibrated camera, with the size of its pictures, to which centres are scaled, and its lens, whose
    distortion is removed, because the projective matrix is valid for undistorted pixels of that size; None: neither.
    fewer_parts: a part that the tracker does not find is never seen. notify: gets one line when pictures of another
    size are scaled, once for each size. Raises BadInput if it does not find a wanted part, or none of them.

    hold: the tracker is not run, and the last tracks are valid for this frame too. resting: nothing changes, so the
    tracks are the mean of the last RESTING_RUNS runs. cost_s: CPU seconds of the last run, by the clock `cpu_s`.
    """

    def __init__(
        self,
        tracker: Tracker,
        wanted: Sequence[str],
        view: View | None = None,
        fewer_parts: bool = False,
        notify: Callable[[str], None] = lambda _: None,
        cpu_s: Callable[[], float] = lambda: 0.0,
    ) -> None:
        self.every_part = tuple(tracker.body_parts)
        """All body parts that the tracker finds, in its order."""
        self.tracker = tracker
        self.body_parts: tuple[str, ...] = ()
        self.lacking: tuple[str, ...] = ()
        """Wanted parts that the tracker does not find."""
        self._rows: list[int] = []
        self.want(wanted, fewer_parts)
        self._view, self._notify, self._cpu_s = view, notify, cpu_s
        self.hold, self.resting, self.cost_s = False, False, 0.0
        self._runs: deque[Floats] = deque(maxlen=RESTING_RUNS)
        self._size_px: Size | None = None
        self._scale = 1.0
        self.picture_tracks: Tracks | None = None
        self.all_tracks: Tracks | None = None
        """The tracker's own rows, of all its body parts, in px of the picture."""

    @property
    def every_track(self) -> Tracks | None:
        """The undistorted tracks of `every_part` in the newest frame; None before the first."""
        tracks = self.all_tracks
        if tracks is None or self._is_plain:
            return tracks
        return Tracks(self._calibrated(tracks.centres), people=tracks.people)

    def want(self, wanted: Sequence[str], fewer_parts: bool = False) -> None:
        """Select these body parts from now on; raises BadInput as the class does, and then changes nothing."""
        known = self.every_part
        lacking = tuple(part for part in wanted if part not in known)
        if lacking and not (fewer_parts and len(lacking) < len(wanted)):
            raise BadInput(lacking_parts(lacking, known))
        self.body_parts, self.lacking = tuple(wanted), lacking
        # One row more, which is never seen, stands for the parts that the tracker does not find.
        self._rows = [known.index(part) if part in known else len(known) for part in wanted]

    def of_parts(self, wanted: Sequence[str]) -> "PreparedTracker":
        """The same tracker for other body parts; raises BadInput if it does not find one of them."""
        return PreparedTracker(self.tracker, wanted, self._view, notify=self._notify)

    @property
    def complaint(self) -> str:
        """Why the tracker finds little in the pictures, and what to do about it; "" if all is well."""
        return str(getattr(self.tracker, "complaint", ""))

    def update(self, frame: Frame) -> Tracks:
        """Undistorted tracks (P, 2); those in px of the picture, to draw on it, are left in `picture_tracks`.

        Raises BadInput for pictures of another shape than the camera file's.
        """
        if self.all_tracks is None or not self.hold:
            begun_s = self._cpu_s()
            tracks = self.tracker.update(frame)
            self.cost_s = self._cpu_s() - begun_s
            self.all_tracks = self._settled(tracks)
        tracks = self.all_tracks
        guesses = None if tracks.guesses is None else self._wanted(tracks.guesses)
        self.picture_tracks = Tracks(self._wanted(tracks.centres), guesses, tracks.people)
        if self._view is None or self._is_plain:
            return self.picture_tracks
        if frame.content.dtype == np.uint8:
            self._fit(self._view, size_of(frame.content))
        calibrated = None if guesses is None else self._calibrated(guesses)
        return Tracks(self._calibrated(self.picture_tracks.centres), calibrated, tracks.people)

    def _settled(self, tracks: Tracks) -> Tracks:
        if not self.resting:
            self._runs.clear()
            return tracks
        self._runs.append(tracks.centres)
        runs = np.array(self._runs)
        visible = np.isfinite(runs)
        means = np.where(visible, runs, 0.0).sum(axis=0) / np.maximum(visible.sum(axis=0), 1)
        return replace(tracks, centres=np.where(np.isfinite(tracks.centres), means, np.nan))

    @property
    def most(self) -> int:
        """How many people the tracker follows."""
        return int(getattr(self.tracker, "most", 1))

    @property
    def tracks_of_all(self) -> Tracks | None:
        """`picture_tracks`, or those of all people, one below the other."""
        persons = () if self.all_tracks is None else self.all_tracks.persons
        return Tracks(np.concatenate([person.centres for person in persons])) if persons else self.picture_tracks

    def persons(self) -> list[PersonTracks]:
        """The people of the newest frame, each as `update` returns the tracks of one."""
        each = () if self.all_tracks is None else self.all_tracks.persons
        return [self._of_person(person) for person in each]

    def _of_person(self, person: PersonTracks) -> PersonTracks:
        every = person.centres if self._is_plain else self._calibrated(person.centres)
        return replace(person, centres=self._wanted(every), every=every)

    @property
    def _is_plain(self) -> bool:
        """Whether pixels of the picture are those of the view."""
        return self._view is None or (self._view.lens is None and self._view.size_px is None)

    def _fit(self, view: View, size_px: Size) -> None:
        """Take the scale of pictures of this size, and say so if they are of another one than the camera file's."""
        if size_px != self._size_px:
            self._scale, self._size_px = picture_scale(view, size_px), size_px
            if note := scale_note(view, size_px):
                self._notify(note)

    def _calibrated(self, centres: Floats) -> Floats:
        """(P, 2) px of the picture -> undistorted px of the camera file."""
        lens = self._view.lens if self._view else None
        return centres * self._scale if lens is None else lens.undistorted(centres * self._scale)

    def _wanted(self, rows: Floats) -> Floats:
        return (np.concatenate([rows, NEVER_SEEN]) if self.lacking else rows)[self._rows]


def lacking_parts(lacking: Sequence[str], tracked: Sequence[str]) -> str:
    """One line: a model reads parts that the tracker does not find, and what to do."""
    return (
        f"body part {lacking[0]!r}: the model reads it, the tracker finds {', '.join(tracked)}; use a tracker with a "
        f'pose model (tracker = "mediapipe"), or learn the model with --body-parts {",".join(tracked)}'
    )
