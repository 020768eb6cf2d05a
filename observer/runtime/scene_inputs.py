"""From an observer's section of the scene file to its source of frames and its tracker: what `observe` runs on."""

import os
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from common.config import ObserverConfig, Scene
from common.errors import BadInput
from observer.camera.base import Report, ignore_report
from observer.foreign.sources import LineTracks, MeshTracks, PipedTracks
from observer.geometry.lens import LensDistortion
from observer.geometry.views import View, parse_view
from observer.motion.archive import MotionArchive, Recording
from observer.motion.archive_file import read_archive
from observer.motion.playback import RecordedMotion
from observer.motion.transforms import resample
from observer.tracking.registry import Content, TrackerSettings, tracker_named
from observer.tracks import BODY_PARTS, Floats, Frame, FrameSource, Tracker, Tracks

PLAYBACK_START = "LABANMESH_PLAYBACK_START_NS"
"""Environment variable: when (Unix epoch, ns) all observers of a scene begin to play, so that they see the same."""
STANDARD_INPUT = "-"
MESH_KEY = "zenoh:"
"""A source that begins so is a key on the mesh under which somebody else's tracks come."""
SIZE_PX = (640, 480)
"""Of the virtual camera's pictures, where the scene file names no other."""


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


@dataclass(frozen=True, slots=True)
class ObserverInputs:
    """What one observer sees with. tracker: its rows are the parts that were wanted.

    at_own_rate: the frames are recorded motion itself, and must come at the model's rate. length: frames of the first
    recording, None where there is no such thing. keeps_all: nothing is left out, however long it takes.
    """

    source: FrameSource
    tracker: PreparedTracker
    view: View
    at_own_rate: bool
    length: int | None
    keeps_all: bool


def open_inputs(
    scene: Scene,
    observer: str,
    wanted: Sequence[str] = BODY_PARTS,
    report: Report = ignore_report,
    environment: Mapping[str, str] = os.environ,
) -> ObserverInputs:
    """Source and tracker that the scene file names for `observer`; wanted: the body parts that its model reads.

    Raises BadInput for an unknown observer, source, tracker or view, for files that are not there or not what they
    should be, and for a tracker that cannot read what the source gives.
    """
    section = scene.observer(observer)
    key = f"observers.{observer}"
    view = parse_view(section.view, scene.place("."))
    content = content_of(section.source)
    kind = tracker_named(section.tracker, f"{key}.tracker", content)
    start_ns = _start_ns(environment.get(PLAYBACK_START))
    if content == "positions":
        motion = _recorded_motion(scene, section, key, start_ns)
        source = motion if kind.reads == "positions" else _filmed(motion, view, section)
    elif content == "tracks":
        source = _tracks(section.source, report)
    else:
        source = _pictures(scene, section, report, start_ns)
    if kind.reads == "pictures":
        _one_thread()
    if section.mirrored:
        if kind.reads != "pictures":
            raise BadInput(f"{key}.mirrored: only pictures can be mirrored back; this source gives {content}")
        source = Unmirrored(source)
    built = kind.build(TrackerSettings(view, source.body_parts, wanted, section, scene.place))
    tracker = PreparedTracker(built, wanted, view.lens)
    length = getattr(source, "length", None)
    return ObserverInputs(source, tracker, view, kind.reads == "positions", length, section.speed == 0)


def _one_thread() -> None:
    """An observer is one process of several on its machine: OpenCV's own threads would only wait for each other."""
    import cv2

    cv2.setNumThreads(1)


def content_of(source: str) -> Content:
    """What the frames of a source hold, by its name alone."""
    if source == STANDARD_INPUT or source.startswith(MESH_KEY):
        return "tracks"
    return "positions" if Path(source).suffix == ".npz" else "pictures"


def _recorded_motion(scene: Scene, section: ObserverConfig, key: str, start_ns: int | None) -> RecordedMotion:
    place = scene.place(section.source)
    archive = read_archive(place)
    chosen = _chosen(archive, section.recording, f"{key}.recording", place)
    if section.rate_hz:
        chosen = [resample(recording, section.rate_hz) for recording in chosen]
    return RecordedMotion(archive.body_parts, chosen, section.speed, section.loop, start_ns)


def _filmed(motion: RecordedMotion, view: View, section: ObserverConfig) -> FrameSource:
    # OpenCV is imported only for who needs pictures.
    from observer.rendering.scenery import Occluder, Scenery
    from observer.rendering.virtual_camera import VirtualCamera

    room, rate_hz = section.virtual, motion.rate_hz
    scenery = Scenery(
        background=room.background,
        noise=room.noise,
        slow_light=room.slow_light,
        sudden_light=room.sudden_light,
        blur=room.blur,
        occluders=tuple(
            Occluder(left, top, width, height, round(begin_s * rate_hz), round(end_s * rate_hz))
            for left, top, width, height, begin_s, end_s in room.occluders
        ),
    )
    return VirtualCamera(motion, view, section.size_px or SIZE_PX, scenery, room.seed)


def _pictures(scene: Scene, section: ObserverConfig, report: Report, start_ns: int | None) -> FrameSource:
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
    )


def _tracks(source: str, report: Report) -> PipedTracks | MeshTracks:
    if source == STANDARD_INPUT:
        return PipedTracks(sys.stdin.buffer, LineTracks("standard input", report))
    key = source.removeprefix(MESH_KEY)
    if not key or key.startswith("/") or key.endswith("/") or "//" in key or any(c in key for c in "*$?# "):
        raise BadInput(f"source = {source!r}: zenoh:KEY is expected, e.g. zenoh:tracks/cam1, without wildcards")
    return MeshTracks(key, LineTracks(source, report))


def _chosen(archive: MotionArchive, which: int | Literal["all"], key: str, place: Path) -> Sequence[Recording]:
    if which == "all":
        return archive.recordings
    if which >= len(archive.recordings):
        raise BadInput(f'{key} = {which}: {place} has recordings 0 to {len(archive.recordings) - 1}; or "all"')
    return archive.recordings[which : which + 1]


def _start_ns(text: str | None) -> int | None:
    if not text:
        return None
    if not text.isdecimal():
        raise BadInput(f"{PLAYBACK_START} = {text!r}: nanoseconds since 1970 are expected, as a whole number")
    return int(text)
