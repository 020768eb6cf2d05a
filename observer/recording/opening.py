"""From a scene to watchers: every observer whose view is a camera file."""

import threading
from collections.abc import Sequence

from common.config import Scene
from common.errors import BadInput
from observer.foreign.sources import MeshTracks
from observer.opening import open_eyes
from observer.recording.watching import Watcher
from observer.tracks import BODY_PARTS


def open_watchers(scene: Scene, observers: Sequence[str], stop: threading.Event) -> list[Watcher]:
    """Those named, else all that look through a calibrated camera; what was recorded comes as fast as it can be read.

    Raises BadInput when they are fewer than two, for one without a camera file, for tracks that come over the mesh, and
    as `open_eyes` does.
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


def _watcher(scene: Scene, name: str, stop: threading.Event) -> Watcher:
    eyes = open_eyes(scene, name, BODY_PARTS)
    if isinstance(eyes.source, MeshTracks):
        raise BadInput(f"observers.{name}.source: tracks that come over the mesh are not recorded; name a camera")
    return Watcher(name, eyes.source.frames(stop), eyes.tracker, eyes.view.matrix)


def _calibrated(scene: Scene, name: str) -> bool:
    return scene.observer(name).view.strip().endswith(".toml")
