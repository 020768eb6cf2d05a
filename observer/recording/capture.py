"""Reads several calibrated cameras at once, each in its own thread."""

import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass

import numpy as np

from common import SECOND_NS
from common.config import Scene
from common.errors import BadInput
from observer.foreign.sources import MeshTracks
from observer.recording.reconstruction import CameraTracks
from observer.runtime.scene_inputs import open_inputs
from observer.tracks import BODY_PARTS, Floats, Frame, Tracker

LOOK_S = 0.2
"""So often the progress is told."""

Progress = Callable[[float], None]
"""Hears how many seconds of motion the camera that is furthest behind has seen."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordingCamera:
    """One camera at work. tracker: its centres are undistorted px, for which `matrix` (3, 4) holds."""

    name: str
    frames: Iterator[Frame]
    tracker: Tracker
    matrix: Floats


class _Watch:
    """What one watcher has seen so far; written by its thread only."""

    def __init__(self, watcher: RecordingCamera, stop: threading.Event, seconds: float | None) -> None:
        self._watcher, self._stop = watcher, stop
        self._most_ns = None if seconds is None else round(seconds * SECOND_NS)
        self._at_ns: list[int] = []
        self._centres: list[Floats] = []

    @property
    def seconds(self) -> float:
        """How much motion it has seen."""
        return (self._at_ns[-1] - self._at_ns[0]) / SECOND_NS if self._at_ns else 0.0

    def run(self) -> None:
        """Frame by frame until there are no more, somebody says stop, or it was long enough."""
        for frame in self._watcher.frames:
            if self._stop.is_set():
                return
            if self._at_ns and self._most_ns is not None and frame.at_ns - self._at_ns[0] > self._most_ns:
                # A live camera's time is everybody's: one that delivers nothing must not be waited for.
                if frame.motion_ns is None:
                    self._stop.set()
                return
            self._at_ns.append(frame.at_ns)
            self._centres.append(self._watcher.tracker.update(frame).centres.copy())

    def sighted(self) -> CameraTracks:
        """What it saw."""
        parts = len(self._watcher.tracker.body_parts)
        centres = np.array(self._centres, dtype=np.float64).reshape(-1, parts, 2)
        return CameraTracks(self._watcher.name, self._watcher.matrix, np.array(self._at_ns, dtype=np.int64), centres)


def watch(
    watchers: Sequence[RecordingCamera],
    stop: threading.Event,
    seconds: float | None = None,
    progress: Progress = lambda _: None,
) -> list[CameraTracks]:
    """What each of them saw, in their order; seconds: of motion, None for all that there is.

    Sets `stop`, which the frames must heed too, when one of them fails, and raises what it raised. Raises BadInput when
    the trackers do not find the same parts.
    """
    parts = {tuple(watcher.tracker.body_parts) for watcher in watchers}
    if len(parts) > 1:
        raise BadInput(f"trackers find different body parts: {'; '.join(', '.join(p) for p in sorted(parts))}")
    watches = [_Watch(watcher, stop, seconds) for watcher in watchers]
    with ThreadPoolExecutor(len(watchers), thread_name_prefix="watch") as pool:
        running = {pool.submit(one.run) for one in watches}
        try:
            while running:
                ended, running = wait(running, LOOK_S, FIRST_COMPLETED)
                for future in ended:
                    future.result()
                progress(min(one.seconds for one in watches))
        finally:
            stop.set()
    return [one.sighted() for one in watches]


def open_watchers(scene: Scene, observers: Sequence[str], stop: threading.Event) -> list[RecordingCamera]:
    """Those named, else all that look through a calibrated camera; what was recorded comes as fast as it can be read.

    Raises BadInput when they are fewer than two, for one without a camera file, for tracks that come over the mesh, and
    as `open_inputs` does.
    """
    for name in observers:
        if not _calibrated(scene, name):
            view = scene.observer(name).view
            raise BadInput(f"observers.{name}.view = {view!r}: a camera file is needed; labanmesh calibrate writes it")
    chosen = list(dict.fromkeys(observers)) or [name for name in scene.roster if _calibrated(scene, name)]
    if len(chosen) < 2:
        names = f": {chosen[0]}" if chosen else ""
        raise BadInput(
            f"{len(chosen)} observer with a camera file as its view{names}; two at least are needed, "
            "labanmesh calibrate writes their files"
        )
    hurried = {name: scene.observer(name).model_copy(update={"speed": 0.0, "loop": False}) for name in scene.roster}
    hurrying = scene.model_copy(update={"observers": hurried})
    return [_watcher(hurrying, name, stop) for name in chosen]


def _watcher(scene: Scene, name: str, stop: threading.Event) -> RecordingCamera:
    eyes = open_inputs(scene, name, BODY_PARTS)
    if isinstance(eyes.source, MeshTracks):
        raise BadInput(f"observers.{name}.source: tracks that come over the mesh are not recorded; name a camera")
    return RecordingCamera(name, eyes.source.frames(stop), eyes.tracker, eyes.view.matrix)


def _calibrated(scene: Scene, name: str) -> bool:
    return scene.observer(name).view.strip().endswith(".toml")
