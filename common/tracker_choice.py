"""Which tracker `tracker = "auto"` means for an observer, and why. Imports no tracker, which takes a second."""

from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

from common.config_sections import ObserverConfig

Content = Literal["positions", "pictures", "tracks"]
"""Content of a frame: (P, 3) metres of recorded motion, (H, W, 3) uint8 pictures, or (P, 3) u, v, confidence."""
AUTO = "auto"
STANDARD_INPUT = "-"
MESH_KEY = "zenoh:"
"""Prefix of a source that is a key on the mesh, under which another program publishes tracks."""
PHONE = "phone"
"""A source whose tracks a phone finds in the pictures of its camera, and sends through `labanmesh phone`."""
PICTURE_TRACKERS = ("camshift", "mediapipe")
INSTALL_MEDIAPIPE = "pip install 'labanmesh[mediapipe]'"
CARRIED_MODEL = "modules/pose_landmark/pose_landmark_full.tflite"
"""The pose model in mediapipe's folder, up to version 0.10.21."""


@dataclass(frozen=True, slots=True)
class TrackerChoice:
    """name: of the tracker. reason: why it was chosen, "" for one that the scene file names. fallback: the tracker to
    take, with a warning, if this one does not start; "" for none. lacks: why the better one was not chosen.
    """

    name: str
    reason: str = ""
    fallback: str = ""
    lacks: str = ""


def content_of(source: str) -> Content:
    """The content of a source's frames, by its name alone."""
    if source in (STANDARD_INPUT, PHONE) or source.startswith(MESH_KEY):
        return "tracks"
    return "positions" if Path(source).suffix == ".npz" else "pictures"


def is_recording(source: str) -> bool:
    """Whether a source is a file or a folder: no camera, address, or tracks of another program."""
    elsewhere = source.isdecimal() or source in (STANDARD_INPUT, PHONE) or "://" in source
    return not (elsewhere or source.startswith(("/dev/", MESH_KEY)))


def chosen_tracker(section: ObserverConfig) -> TrackerChoice:
    """The tracker of an observer; for one that the scene file leaves open, the best that can be used here."""
    if section.tracker != AUTO:
        return TrackerChoice(section.tracker)
    content = content_of(section.source)
    if content != "pictures":
        return TrackerChoice("projected" if content == "positions" else "foreign", f"the source gives {content}")
    return _for_pictures(section)


def _for_pictures(section: ObserverConfig) -> TrackerChoice:
    """The only tracker that reads a setting of the section; else mediapipe, if it is installed with a model."""
    if section.pose_model:
        return TrackerChoice("mediapipe", "pose_model is set")
    if section.skin or section.face:
        return TrackerChoice("camshift", f"{'skin' if section.skin else 'face'} is set")
    lacks = mediapipe_lacks()
    if lacks:
        return TrackerChoice("camshift", lacks, lacks=lacks)
    return TrackerChoice("mediapipe", f"mediapipe {_version()} is installed, with its model", fallback="camshift")


def mediapipe_lacks() -> str:
    """Why mediapipe cannot be used without a model file, one clause with the way out; "" if it probably can."""
    spec = find_spec("mediapipe")
    if spec is None:
        return f"mediapipe, which finds whole bodies, is not installed: {INSTALL_MEDIAPIPE}"
    if any((Path(folder) / CARRIED_MODEL).is_file() for folder in spec.submodule_search_locations or ()):
        return ""
    return f"mediapipe {_version()} carries no pose model: name a .task file as pose_model (docs/guide/cameras.md)"


def _version() -> str:
    try:
        return version("mediapipe")
    except PackageNotFoundError:
        return "(unknown version)"
