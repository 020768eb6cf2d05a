"""The folder in which observers of recordings wait for each other, so that all begin together."""

from pathlib import Path

from common.config import Scene


def open_meeting(folder: Path, scene: Scene) -> Path:
    """A folder in which the observers that play recordings in real time wait for each other, with a file for each."""
    meeting = folder / "meeting"
    meeting.mkdir()
    for observer, section in scene.observers.items():
        if section.speed and _is_recording(section.source):
            (meeting / f"{observer}.awaited").touch()
    return meeting


def _is_recording(source: str) -> bool:
    """Whether a source is a file or a folder: no camera, address, or tracks of another program."""
    return not (source == "-" or source.isdecimal() or source.startswith(("/dev/", "zenoh:")) or "://" in source)
