"""Recorded motion as a view sees it: a projective matrix replaces the camera and its tracker.

Tracks of one camera are what it saw; only the view `camera` fits them. For the room of calibrated cameras, people are
first put where a person will stand in it: archives have axes of their own, x to the performer's right, y up, z to the
performer's back, and a Kinect's performers stand 2 to 3 m from its origin and face it. Of several people in one room
the one nearer to the camera covers others: a part behind the trunk or the head of somebody else is not seen.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from common import SECOND_NS
from common.errors import BadInput
from observer.geometry.placement import PersonPlacement
from observer.geometry.projection import oriented, project
from observer.geometry.views import THIS_CAMERA, View, parse_view, this_camera, turned
from observer.motion.archive import MotionArchive, Recording, TracksCamera
from observer.tracking.person_keeper import Detection, PersonKeeper, detection_of, rows_of_people, seen_people
from observer.tracks import Floats, Frame, Tracks


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
        """The recorded positions in the view's image; a part that is missing in this frame is not seen.

        Recorded tracks, (P, 2), stay as they are.
        """
        return Tracks(_seen(self._view, frame.content[self._rows]))


def view_tracks(view: View, recording: Recording, recorded: tuple[str, ...], wanted: tuple[str, ...]) -> list[Tracks]:
    """The tracks of all frames of a recording, seen from the view, as a `ProjectedTracker` finds them, but faster."""
    positions = recording.positions[:, _rows_of(wanted, recorded)].astype(np.float64)
    return [Tracks(centres) for centres in _seen(view, positions)]


def _seen(view: View, positions: Floats) -> Floats:
    """(..., 3) positions in the view's image, or (..., 2) tracks as they are, with both coordinates or none."""
    if positions.shape[-1] == 3:
        return project(view.matrix, positions)
    return np.where(np.isfinite(positions).all(axis=-1, keepdims=True), positions, np.nan)


def projected(archive: MotionArchive, view: View, camera: TracksCamera) -> MotionArchive:
    """The archive as tracks (F, P, 2) of a camera that sees from `view`, in the view's unit; spans stay.

    Recordings of which it sees nothing are left out. Raises BadInput for an archive of tracks and the view `camera`.
    """
    require_view(view, archive.recordings)
    if view.is_this_camera:
        raise BadInput("these are the tracks of one camera already; only positions in 3-D can be seen from a view")
    shown = (project(view.matrix, r.positions.astype(np.float64)).astype(np.float32) for r in archive.recordings)
    recordings = tuple(
        replace(r, positions=centres)
        for r, centres in zip(archive.recordings, shown, strict=True)
        if np.isfinite(centres).any()
    )
    return MotionArchive(archive.body_parts, recordings, camera)


def view_of(archive: MotionArchive, text: str, name: str = "") -> View:
    """The view by its name, checked against the archive; "" is the archive's own camera for tracks.

    name: of that camera, where the archive has none. Raises BadInput for "" with 3-D positions, and as `parse_view` and
    `require_view` do.
    """
    if archive.camera is not None and text in ("", THIS_CAMERA):
        return this_camera(archive.camera.name or name)
    view = parse_view(text)
    require_view(view, archive.recordings)
    return view


def require_view(view: View, recordings: Sequence[Recording], facings: int = 1) -> None:
    """Raise BadInput if the view cannot show the recordings, and for turns of what is no longer in space."""
    for recording in recordings:
        if view.is_this_camera and recording.positions.shape[2] == 3:
            raise BadInput(f"view {view.name}: the recordings are positions in 3-D; say from where they are seen: door")
        if not view.is_this_camera and recording.positions.shape[2] == 2:
            raise BadInput(
                f"view {view.name}: the recordings are 2-D tracks of one camera; give no view, or {THIS_CAMERA}"
            )
    if view.is_this_camera and facings > 1:
        raise BadInput(
            f"parameter facings={facings}: 2-D tracks cannot be turned; omit it, and record people as they turn"
        )


def require_same_camera(archive: MotionArchive, other: MotionArchive, place: str) -> None:
    """Raise BadInput, one line beginning with `place` of the other archive, if one model may not use both."""
    if (archive.camera is None) != (other.camera is None):
        kinds = ("2-D tracks of one camera", "positions in 3-D")
        theirs, ours = kinds if other.camera is not None else reversed(kinds)
        raise BadInput(f"{place}: {theirs}, but the movements are {ours}; one model learns from one kind")
    if archive.camera is None or other.camera is None:
        return
    ours, theirs = archive.camera.name, other.camera.name
    if ours and theirs and ours != theirs:
        raise BadInput(
            f"{place}: tracks of {theirs}, but the movements are tracks of {ours}; a model is for one camera"
        )


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


UPRIGHT = 90.0
"""Percentile of the head's heights in a recording that is its height while the person stands upright."""


def placed(archive: MotionArchive, placement: PersonPlacement) -> MotionArchive:
    """The archive with each person at `placement`, turned in place.

    Each recording is moved so that the mean place of its head on the floor is the placement's; all of them are raised
    by the same height, which brings the median height of the upright heads to the placement's. Without a part `head`
    the mean of all parts stands for it.
    """
    rows = _head_rows(archive)
    heights = [_upright_m(recording.positions[:, rows]) for recording in archive.recordings]
    known = [height for height in heights if math.isfinite(height)]
    raised_m = placement.head_m - float(np.median(known)) if known else 0.0
    recordings = []
    for recording in archive.recordings:
        centre = _floor_centre(recording.positions, rows)
        step = np.array([placement.x_m - centre[0], raised_m, placement.z_m - centre[2]])
        facing = turned(recording.positions, math.radians(placement.facing_deg), centre)
        recordings.append(replace(recording, positions=(facing + step).astype(np.float32)))
    return replace(archive, recordings=tuple(recordings))


def mean_place(archive: MotionArchive) -> tuple[float, float]:
    """x and z where the archive's people stand, on average over the recordings, m."""
    rows = _head_rows(archive)
    centre = np.mean([_floor_centre(recording.positions, rows) for recording in archive.recordings], axis=0)
    return float(centre[0]), float(centre[2])


def _head_rows(archive: MotionArchive) -> list[int]:
    """The row of the head, or all rows without one."""
    parts = archive.body_parts
    return [parts.index("head")] if "head" in parts else list(range(len(parts)))


def _upright_m(heads: NDArray[np.float32]) -> float:
    """(F, H, 3) -> the height of the upright person's head; NaN if it was never seen."""
    heights = heads[..., 1][np.isfinite(heads).all(axis=-1)]
    return float(np.percentile(heights, UPRIGHT)) if len(heights) else math.nan


def _floor_centre(positions: NDArray[np.float32], rows: list[int]) -> Floats:
    """(3,) the mean of the head, or of all parts where the head was never seen."""
    heads = positions[:, rows]
    points = heads if np.isfinite(heads).all(axis=-1).any() else positions
    centre: Floats = points[np.isfinite(points).all(axis=-1)].mean(axis=0, dtype=np.float64)
    return centre


TRUNK_M, HEAD_M = 0.16, 0.12
"""Half the width of a trunk, as wide as half the shoulders of an adult; the radius of a head."""


class ProjectedPeople:
    """A tracker of the recorded people, of at most `most`; recorded: names of the rows of a frame's content."""

    def __init__(self, view: View, recorded: Sequence[str], most: int) -> None:
        self.body_parts, self._rows = rows_of_people(recorded)
        self._view, self._keeper, self.most = view, PersonKeeper(most), most

    def update(self, frame: Frame) -> Tracks:
        """The people whom the view shows."""
        people = [frame.content[rows] for rows in self._rows]
        bodies = [body for n, _ in enumerate(people) if (body := self._seen(people, n)) is not None]
        persons = self._keeper.update(bodies, frame.at_ns)
        nobody = np.full((len(self.body_parts), 2), np.nan)
        return Tracks(persons[0].centres if persons else nobody, people=seen_people(persons), persons=persons)

    def _seen(self, people: Sequence[Floats], n: int) -> Detection | None:
        """What is seen of one of them; None if that is too little."""
        centres = project(self._view.matrix, people[n])
        whole = centres[np.isfinite(centres).all(axis=1)]
        for m, other in enumerate(people):
            if m != n:
                centres[self._covered(people[n], centres, other)] = np.nan
        return detection_of(centres, whole)

    def _covered(self, own: Floats, centres: Floats, other: Floats) -> np.ndarray:
        """(P,) which parts are behind the trunk or the head of `other`."""
        trunk = [other[self.body_parts.index(part)] for part in ("neck", "pelvis", "head") if part in self.body_parts]
        axis = np.array(trunk)
        places = project(self._view.matrix, axis)
        known = np.isfinite(places).all(axis=1)
        if not known.any():
            return np.zeros(len(own), dtype=bool)
        H = oriented(self._view.matrix)
        depth, px = _depths(H, own, axis[known].mean(axis=0))
        behind = depth > 0
        near = _distance_to(centres, places[known]) < TRUNK_M * px
        return behind & near


def _depths(H: Floats, points: Floats, at: Floats) -> tuple[Floats, float]:
    """How much farther (P,) points are than `at`, along the way of looking; and px of a metre there."""
    axis = np.cross(H[0, :3], H[1, :3]) if not H[2, :3].any() else H[2, :3]
    looking = axis / np.linalg.norm(axis)
    w = float(H[2, :3] @ at + H[2, 3])
    across = H[0, :3] - (H[0, :3] @ looking) * looking
    return (points - at) @ looking, float(np.linalg.norm(across)) / w


def _distance_to(centres: Floats, places: Floats) -> Floats:
    """(P,) px from centres to the broken line through the places."""
    best = np.full(len(centres), np.inf)
    for begin, end in zip(places, [*places[1:], places[-1]], strict=True):
        along = end - begin
        share = np.clip(((centres - begin) @ along) / max(float(along @ along), 1e-12), 0.0, 1.0)
        gap = np.linalg.norm(centres - begin - share[:, None] * along, axis=1)
        best = np.fmin(best, gap)
    return best
