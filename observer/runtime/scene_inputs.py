"""Opens the source of frames and the tracker that the scene file names for an observer."""

import logging
import os
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from common import SECOND_NS
from common.config import ObserverConfig, Scene
from common.errors import BadInput
from common.tracker_choice import MESH_KEY, PHONE, STANDARD_INPUT, chosen_tracker, content_of
from observer.camera.base import Report, ignore_report
from observer.foreign import LineTracks, MeshTracks, PipedTracks
from observer.geometry.placement import PersonPlacement, placement_of
from observer.geometry.views import View, parse_view, picture_scale
from observer.motion.archive import MotionArchive, Recording, resample
from observer.motion.archive_file import read_archive
from observer.motion.playback import BARRIER, RecordedMotion, Start, StartBarrier
from observer.motion.projected import placed
from observer.prepared_tracks import PreparedTracker
from observer.tracking.person_keeper import has_several, of_people
from observer.tracking.registry import built_tracker, tracker_named
from observer.tracking.tracker_kind import TrackerSettings
from observer.tracks import BODY_PARTS, WHOLE_BODY, Frame, FrameSource

log = logging.getLogger("labanmesh.observer")
PLAYBACK_START = "LABANMESH_PLAYBACK_START_NS"
"""Environment variable: when (Unix epoch, ns) all observers of a scene start playback, so that they see the same."""
PLAYBACK_START_DIGITS, PLAYBACK_AHEAD_S = 19, 86400.0
SIZE_PX = (640, 480)
"""Default size of the virtual camera's pictures, where the camera file has none."""


class UnmirroredSource:
    """Flips the pictures of a mirrored source, such as a webcam in selfie mode, so that right is right again."""

    def __init__(self, mirrored: FrameSource) -> None:
        self.mirrored, self.rate_hz, self.body_parts = mirrored, mirrored.rate_hz, mirrored.body_parts

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """The same frames, each flipped horizontally."""
        for frame in self.mirrored.frames(stop):
            # A copy, because OpenCV needs rows that run to the right in memory too.
            yield replace(frame, content=np.ascontiguousarray(frame.content[:, ::-1]))


@dataclass(frozen=True, slots=True)
class ObserverInputs:
    """The source, tracker and view of one observer; the tracker's rows are the wanted body parts.

    at_own_rate: frames are recorded motion itself, whose rate must be the model's. length: frames of the first
    recording, None for sources without one. keeps_all: no frame is dropped, however slow the observer is.
    pictures: the tracker reads pictures.
    """

    source: FrameSource
    tracker: PreparedTracker
    view: View
    at_own_rate: bool
    length: int | None
    keeps_all: bool
    pictures: bool = False


def open_inputs(
    scene: Scene,
    observer: str,
    wanted: Sequence[str] | None = BODY_PARTS,
    report: Report = ignore_report,
    environment: Mapping[str, str] = os.environ,
    fewer_parts: bool = False,
    smooth: bool = True,
) -> ObserverInputs:
    """Open the source and the tracker of `observer`.

    wanted: the body parts that its model reads; None: it has no model yet, and all parts that the tracker finds are
    wanted (of other programs' tracks hands and head, or the whole body where several people are judged; of a phone's
    the whole body). fewer_parts: as in `PreparedTracker`. smooth: as in `TrackerSettings`.

    Raises BadInput for an unknown observer, source, tracker or view, for files that are missing or invalid, and for a
    tracker that cannot read what the source delivers.
    """
    section, key = scene.observer(observer), f"observers.{observer}"
    view, content = parse_view(section.view, scene.place(".")), content_of(section.source)
    choice = chosen_tracker(section)
    kind = tracker_named(choice.name, f"{key}.tracker", content)
    pictures = kind.reads == "pictures"
    most = people_followed(scene.people.most, len(scene.roster), view)
    if content == "tracks":
        source: FrameSource = _tracks(scene, observer, report, wanted, most)
    else:
        source = _played(scene, observer, view, pictures, report, _start(environment, observer))
    if section.mirrored and not pictures:
        raise BadInput(f"{key}.mirrored: only pictures can be mirrored back; this source gives {content}")
    settings = TrackerSettings(view, source.body_parts, wanted or (), section, scene.place, smooth, most)
    tracker, outcome = built_tracker(choice, kind, settings)
    if pictures:
        level = logging.INFO if outcome is choice else logging.WARNING
        log.log(level, "%s: tracker %s: %s", observer, outcome.name, outcome.reason or "named in the scene file")
    parts, notify = wanted or tracker.body_parts, partial(log.warning, "%s: %s", observer)
    prepared = PreparedTracker(tracker, parts, view, fewer_parts, notify, time.process_time)
    if prepared.lacking:
        log.warning("%s: judges without %s: the tracker does not find them", observer, ", ".join(prepared.lacking))
    length = getattr(source, "length", None)
    return ObserverInputs(source, prepared, view, kind.reads == "positions", length, section.speed == 0, pictures)


def _played(scene: Scene, observer: str, view: View, pictures: bool, report: Report, start_ns: Start) -> FrameSource:
    """Recorded motion or pictures, the virtual camera's if pictures are wanted of motion.

    Raises BadInput also for pictures whose size does not fit the view.
    """
    section = scene.observer(observer)
    if content_of(section.source) == "pictures":
        source = _pictures(scene, section, report, start_ns)
    else:
        motion = _recorded_motion(scene, observer, view, start_ns)
        _require_shown(motion, view, f"observers.{observer}", pictures=pictures)
        if not pictures:
            return motion
        source = _virtual_camera(motion, view, section)
    use_one_thread()
    if size_px := section.size_px or getattr(source, "size_px", None):
        picture_scale(view, size_px)
    return UnmirroredSource(source) if section.mirrored else source


def person_in(scene: Scene, observer: str, view: View) -> PersonPlacement | None:
    """Where the scene says that the person stands in the room of this view; None for a view that has no room."""
    person = scene.person_for(observer)
    return placement_of(person.place, person.facing) if view.has_place else None


def use_one_thread() -> None:
    """Let OpenCV use one thread: an observer is one process of several, and more threads would only compete."""
    import cv2

    cv2.setNumThreads(1)


def _recorded_motion(scene: Scene, observer: str, view: View, start_ns: Start) -> RecordedMotion:
    """The recordings, for a camera file with the people where the scene says that they stand."""
    section, path = scene.observer(observer), scene.place(scene.observer(observer).source)
    archive = read_archive(path)
    placement = person_in(scene, observer, view)
    in_space = archive.camera is None and not has_several(archive.body_parts)
    archive = placed(archive, placement) if placement and in_space else archive
    recordings = _select(archive, section.recording, f"observers.{observer}.recording", path)
    if section.rate_hz:
        recordings = [resample(recording, section.rate_hz) for recording in recordings]
    return RecordedMotion(archive.body_parts, recordings, section.speed, section.loop, start_ns)


def _require_shown(motion: RecordedMotion, view: View, key: str, pictures: bool) -> None:
    """Tracks are played as they are, whatever the view: it says what is known about the camera."""
    tracks = motion.recordings[0].positions.shape[2] == 2
    if tracks and pictures:
        raise BadInput(f"{key}.tracker: the source holds 2-D tracks, which no tracker can film; omit tracker")
    if view.is_this_camera and not tracks:
        raise BadInput(f"{key}.view = {view.name!r}: the source holds positions in 3-D; name a view, e.g. door")


def _virtual_camera(motion: RecordedMotion, view: View, section: ObserverConfig) -> FrameSource:
    # OpenCV is loaded only by observers that need pictures.
    from observer.rendering.scenery import WEBCAM_NOISE, Scenery
    from observer.rendering.virtual_camera import VirtualCamera

    size_px = section.size_px or view.size_px or SIZE_PX
    return VirtualCamera(motion, view, size_px, Scenery(noise=WEBCAM_NOISE))


def _pictures(scene: Scene, section: ObserverConfig, report: Report, start_ns: Start) -> FrameSource:
    from observer.camera.opening import open_pictures

    return open_pictures(
        section.source,
        scene.place("."),
        report=report,
        rate_hz=section.rate_hz,
        size_px=section.size_px,
        speed=section.speed,
        loop=section.loop,
        start_ns=start_ns,
        show_path=section.show_path,
    )


def _tracks(
    scene: Scene, observer: str, report: Report, wanted: Sequence[str] | None, most: int
) -> PipedTracks | MeshTracks:
    """Of the wanted parts, whatever their names: another program may follow more of the body, or other things."""
    source = scene.observer(observer).source
    if source == PHONE:
        name, way_out = f"phone {observer}", f"open the page of labanmesh phone {scene.file} {observer} on it"
        lines = LineTracks(name, report, body_parts=tuple(wanted or WHOLE_BODY), way_out=way_out)
        return MeshTracks(scene.keys.tracks(observer), lines)
    wanted = tuple(wanted or BODY_PARTS)
    if most > 1:
        # Hands and head alone hardly tell where somebody stands.
        wanted = of_people((*wanted, *(part for part in WHOLE_BODY if part not in wanted)), most)
    if source == STANDARD_INPUT:
        return PipedTracks(sys.stdin.buffer, LineTracks("standard input", report, body_parts=wanted))
    key = source.removeprefix(MESH_KEY)
    if not key or key.startswith("/") or key.endswith("/") or "//" in key or any(c in key for c in "*$?# "):
        raise BadInput(f"source = {source!r}: zenoh:KEY is expected, e.g. zenoh:tracks/cam1, without wildcards")
    return MeshTracks(key, LineTracks(source, report, body_parts=wanted))


def _select(archive: MotionArchive, which: int | Literal["all"], key: str, path: Path) -> Sequence[Recording]:
    if which == "all":
        return archive.recordings
    if which >= len(archive.recordings):
        raise BadInput(f'{key} = {which}: {path} has recordings 0 to {len(archive.recordings) - 1}; or "all"')
    return archive.recordings[which : which + 1]


def _start(environment: Mapping[str, str], observer: str) -> Start:
    start_ns, folder = _start_ns(environment.get(PLAYBACK_START)), environment.get(BARRIER)
    return StartBarrier(Path(folder), observer, start_ns or 0) if folder else start_ns


def _start_ns(text: str | None) -> int | None:
    if not text:
        return None
    if not text.isdecimal() or len(text) > PLAYBACK_START_DIGITS:
        raise BadInput(f"{PLAYBACK_START} = {text[:40]!r}: nanoseconds since 1970 are expected, as a whole number")
    ahead_s = int(text) / SECOND_NS - time.time()
    if ahead_s > PLAYBACK_AHEAD_S:
        raise BadInput(
            f"{PLAYBACK_START} = {text!r}: {ahead_s / 86400:.0f} days from now; nanoseconds since 1970 are expected, "
            "of a time within a day"
        )
    return int(text)


def is_untaught(scene: Scene, observer: str) -> bool:
    """Whether the observer waits to be taught: the scene names no model and no vocabulary, and there is no ID.model."""
    section = scene.observer(observer)
    return scene.vocabulary is None and section.model == f"{observer}.model" and not scene.model_file(observer).exists()


def people_followed(most: int, observers: int, view: View) -> int:
    """How many people the observer follows: `most`, as the scene judges, if people can be told apart, else one.

    They can be told apart by where they stand, if the view is a camera file, or if no other of the `observers` looks.
    """
    return most if view.has_place or observers == 1 else 1


def follows_one(most: int, observers: int, view: View, followed: int) -> str:
    """A line that the observer follows one person although the scene judges several, and what to do; "" if it does not.

    followed: how many people its tracker follows.
    """
    if followed > 1 or most == 1:
        return ""
    can_tell = people_followed(most, observers, view) == most
    way_out = "choose the tracker mediapipe" if can_tell else "calibrate this camera"
    return f"follows one person, who counts while nobody else is there; to tell several apart {way_out}"
