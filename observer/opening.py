"""From an observer's section of the scene file to its source of frames and its tracker: what `observe` runs on."""

import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from common.config import ObserverConfig, Scene
from common.errors import BadInput
from observer.camera.base import Report, unheard
from observer.foreign.sources import LineTracks, MeshTracks, PipedTracks
from observer.geometry.views import View, parse_view
from observer.motion.archive import MotionArchive, Recording
from observer.motion.archive_file import read_archive
from observer.motion.resample import resample
from observer.prepared import PreparedTracker, Unmirrored
from observer.source import FrameSource, RecordedMotion
from observer.tracking.registry import Content, TrackerSettings, tracker_named
from observer.tracks import BODY_PARTS

PLAYBACK_START = "LABANMESH_PLAYBACK_START_NS"
"""Environment variable: when (Unix epoch, ns) all observers of a scene begin to play, so that they see the same."""
STANDARD_INPUT = "-"
MESH_KEY = "zenoh:"
"""A source that begins so is a key on the mesh under which somebody else's tracks come."""
SIZE_PX = (640, 480)
"""Of the virtual camera's pictures, where the scene file names no other."""


@dataclass(frozen=True, slots=True)
class Eyes:
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


def open_eyes(
    scene: Scene,
    observer: str,
    wanted: Sequence[str] = BODY_PARTS,
    report: Report = unheard,
    environment: Mapping[str, str] = os.environ,
) -> Eyes:
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
    return Eyes(source, tracker, view, kind.reads == "positions", length, section.speed == 0)


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
