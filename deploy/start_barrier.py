"""Makes the start barrier of a scene's recordings, at which their observers wait so that all begin together.

observer/runtime/start_barrier.py waits at it.
"""

from pathlib import Path

from common.config import Scene
from common.tracker_choice import is_recording


def open_start_barrier(folder: Path, scene: Scene) -> Path:
    """A new folder below `folder`, with a file ID.awaited for each observer that plays a recording in real time."""
    barrier = folder / "barrier"
    barrier.mkdir()
    for observer, section in scene.observers.items():
        if section.speed and is_recording(section.source):
            (barrier / f"{observer}.awaited").touch()
    return barrier
