"""Reads several calibrated cameras at once, each in its own thread, until they end or enough was recorded."""

import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass, field

import numpy as np

from common import SECOND_NS
from common.config import Scene
from common.errors import BadInput
from common.text import plural
from observer.foreign import MeshTracks
from observer.recording.reconstruction import CameraTracks
from observer.runtime.scene_inputs import ObserverInputs, open_inputs
from observer.tracks import BODY_PARTS, Floats, Frame, Tracker

PROGRESS_S = 0.2
"""Interval of the progress reports."""

Progress = Callable[[float], None]
"""Receives the seconds of motion that the slowest camera has recorded."""


@dataclass(slots=True, eq=False)
class RecordingCamera:
    """A camera that one thread records. tracker: its centres are undistorted px, for which `matrix` (3, 4) holds."""

    name: str
    frames: Iterator[Frame]
    tracker: Tracker
    matrix: Floats
    _at_ns: list[int] = field(default_factory=list)
    _centres: list[Floats] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        """Duration of the motion recorded so far."""
        return (self._at_ns[-1] - self._at_ns[0]) / SECOND_NS if self._at_ns else 0.0

    def run(self, stop: threading.Event, seconds: float | None) -> None:
        """Read frames until the source ends, `stop` is set or the time limit is reached."""
        for frame in self.frames:
            if stop.is_set():
                return
            if self._at_ns and seconds is not None and frame.at_ns - self._at_ns[0] > seconds * SECOND_NS:
                # Live cameras share one clock: stop them all, since one that delivers nothing would never end.
                if frame.motion_ns is None:
                    stop.set()
                return
            self._at_ns.append(frame.at_ns)
            self._centres.append(self.tracker.update(frame).centres.copy())

    def tracks(self) -> CameraTracks:
        """The tracks recorded so far."""
        centres = np.array(self._centres, dtype=np.float64).reshape(-1, len(self.tracker.body_parts), 2)
        complaint, at_ns = str(getattr(self.tracker, "complaint", "")), np.array(self._at_ns, dtype=np.int64)
        return CameraTracks(self.name, self.matrix, at_ns, centres, complaint)


def read_cameras(
    cameras: Sequence[RecordingCamera],
    stop: threading.Event,
    seconds: float | None = None,
    progress: Progress = lambda _: None,
) -> list[CameraTracks]:
    """The tracks of all cameras, in their order. seconds: of motion; None reads until the sources end.

    When a camera fails, sets `stop`, which the frames must obey too, and raises that error. Raises BadInput when the
    trackers find different parts.
    """
    parts = {tuple(camera.tracker.body_parts) for camera in cameras}
    if len(parts) > 1:
        raise BadInput(f"trackers find different body parts: {'; '.join(', '.join(p) for p in sorted(parts))}")
    with ThreadPoolExecutor(len(cameras), thread_name_prefix="camera") as pool:
        running = {pool.submit(camera.run, stop, seconds) for camera in cameras}
        try:
            while running:
                ended, running = wait(running, PROGRESS_S, FIRST_COMPLETED)
                for future in ended:
                    future.result()
                progress(min(camera.seconds for camera in cameras))
        finally:
            stop.set()
    return [camera.tracks() for camera in cameras]


def open_cameras(
    scene: Scene, observers: Sequence[str], stop: threading.Event, also: Sequence[str] | None = None
) -> list[RecordingCamera]:
    """The cameras of `observers`, or of all observers with a camera file; recorded sources play at full speed.

    also: body parts to track beside hands and head, those that all trackers find; None: every one that they find.

    Raises BadInput for fewer than two, for an observer without a camera file, for tracks from the mesh, and as
    `open_inputs` does.
    """
    for name in observers:
        if not _is_calibrated(scene, name):
            view = scene.observer(name).view
            way_out = "labanmesh camera calibrate writes it"
            raise BadInput(f"observers.{name}.view = {view!r}: a camera file is needed; {way_out}")
    chosen = list(dict.fromkeys(observers)) or [name for name in scene.roster if _is_calibrated(scene, name)]
    if len(chosen) < 2:
        names = f" ({chosen[0]})" if chosen else ""
        raise BadInput(
            f"{plural(len(chosen), 'observer')} with a camera file as view{names}; at least two are needed; "
            "labanmesh camera calibrate writes camera files"
        )
    sections = {name: scene.observer(name).model_copy(update={"speed": 0.0, "loop": False}) for name in scene.roster}
    whole = scene.model_copy(update={"observers": sections})
    opened = {name: _opened(whole, name) for name in chosen}
    tracked_parts = [inputs.tracker.tracker.body_parts for inputs in opened.values()]
    others = [part for part in (tracked_parts[0] if also is None else also) if part not in BODY_PARTS]
    parts = (*BODY_PARTS, *(part for part in others if all(part in each for each in tracked_parts)))
    return [
        RecordingCamera(name, inputs.source.frames(stop), inputs.tracker.of_parts(parts), inputs.view.matrix)
        for name, inputs in opened.items()
    ]


def _opened(scene: Scene, name: str) -> ObserverInputs:
    inputs = open_inputs(scene, name, BODY_PARTS, smooth=False)
    if isinstance(inputs.source, MeshTracks):
        raise BadInput(f"observers.{name}.source: tracks from the mesh cannot be recorded; name a camera")
    return inputs


def _is_calibrated(scene: Scene, name: str) -> bool:
    return scene.observer(name).view.strip().endswith(".toml")
