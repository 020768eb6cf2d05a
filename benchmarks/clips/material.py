"""The films with their truth, and MediaPipe's tracks in them, tracked once and kept in a folder."""

import csv
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from common import SECOND_NS
from observer.camera.opening import open_pictures
from observer.files import read_arrays, write_arrays
from observer.geometry.camera_file import CameraModel, write_camera
from observer.geometry.views import View, parse_view
from observer.motion.archive import MotionArchive
from observer.motion.importers.florence3d import FLORENCE_HZ, import_folder
from observer.runtime.scene_inputs import UnmirroredSource
from observer.tracks import BODY_PARTS, Floats, Frame, Picture, require_picture
from studies.sensors import with_parts

CLIPS, WEBCAM, RECORDINGS = "florence3d_videos", "wave_webcam", "florence3d"
"""Folders of LABANMESH_DATA: the films, and the recordings in 3-D of which the clips are parts."""
CAMERA = np.array([[-580.0, 0.0, 319.0, 0.0], [0.0, -580.0, 240.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
"""(3, 4) of the unmirrored clips: the originals have u = 320 + 580 x/z, and u' = 639 - u."""
FOUR = ("wave", "answer_phone", "clap", "read_watch")
"""The movements that the clips show, of the nine of Florence 3D Actions."""


@dataclass(frozen=True, slots=True)
class Clip:
    """A film. label: the movement that it shows; "": none. subject: who is in it; "": nobody of the recordings.

    scale: its pictures are reduced by that, and padded with black to their former size.
    """

    file: Path
    label: str
    subject: str
    mirrored: bool
    scale: float = 1.0

    @property
    def name(self) -> str:
        """The file's name without its end."""
        return self.file.stem


def gesture_clips(data: Path) -> list[Clip]:
    """The 16 clips of Florence 3D Actions. They are cut close: 9 to 27 frames, some without begin or end."""
    rows = csv.DictReader((data / CLIPS / "labels.csv").read_text().splitlines())
    return [
        Clip(data / CLIPS / row["file"], row["class"].replace(" ", "_"), row["subject"], mirrored=True) for row in rows
    ]


def webcam_clips(data: Path) -> list[Clip]:
    """A person who waves with one hand, later with both; and the same person standing."""
    waves, stands = (data / WEBCAM / name for name in ("wave.mp4", "stand.mp4"))
    return [Clip(waves, "wave", "", mirrored=False), Clip(stands, "", "", mirrored=False)]


def recordings(data: Path) -> MotionArchive:
    """All 215 recordings of Florence 3D Actions: hands and head, as the tracks of the clips."""
    return with_parts(import_folder(data / RECORDINGS).archive, BODY_PARTS)


def clip_view(name: str) -> View:
    """A view by its name; `camera`: the camera of the clips."""
    return View("camera", CAMERA) if name == "camera" else parse_view(name)


def write_clip_camera(path: Path) -> None:
    """Write the camera file of the unmirrored clips."""
    write_camera(path, CameraModel("camera", CAMERA, (640, 480), provenance="fitted to the joints of all clips"))


def centres_in(clip: Clip, folder: Path) -> Floats:
    """(F, 3, 2) px, what the mediapipe tracker finds in the clip, from NAME.npz in `folder`; see `track_pictures`."""
    scale = "" if clip.scale == 1.0 else f"_{clip.scale:.3g}"
    return track_pictures(lambda: pictures_of(clip), FLORENCE_HZ, folder / f"{clip.name}{scale}.npz")


def pictures_of(clip: Clip) -> Iterator[Picture]:
    """The clip's pictures in its scale, mirrored back if they are mirrored."""
    film = open_pictures(str(clip.file.absolute()), Path(), speed=0)
    source = UnmirroredSource(film) if clip.mirrored else film
    for frame in source.frames(threading.Event()):
        yield _reduced(require_picture(frame.content), clip.scale)


def _reduced(picture: Picture, scale: float) -> Picture:
    """The picture smaller, in the middle of a black one of its former size."""
    if scale == 1.0:
        return picture
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    result = np.zeros_like(picture)
    top, left = ((whole - part) // 2 for whole, part in zip(picture.shape[:2], small.shape[:2], strict=True))
    result[top : top + small.shape[0], left : left + small.shape[1]] = small
    return result


def write_reduced(clip: Clip, folder: Path) -> Clip:
    """The clip as it is if its scale is 1; else a clip of the pictures that are written into a new folder there."""
    if clip.scale == 1.0:
        return clip
    target = folder / clip.name
    target.mkdir()
    for number, picture in enumerate(pictures_of(clip)):
        cv2.imwrite(str(target / f"{number:06d}.png"), picture)
    return Clip(target, clip.label, clip.subject, mirrored=False)


def track_pictures(pictures: Callable[[], Iterator[Picture]], rate_hz: float, path: Path) -> Floats:
    """(F, 3, 2) px of hands and head, NaN where a part is not seen, by a new mediapipe tracker.

    They are read from the file (times_ns, centres, parts), or written there. Raises BadInput without mediapipe if the
    file is missing.
    """
    if not path.exists():
        # Imported here: with all tracks at hand, mediapipe is not needed.
        from observer.tracking.mediapipe_pose import MediapipeTracker

        tracker, period_ns = MediapipeTracker(), round(SECOND_NS / rate_hz)
        centres = [tracker.update(Frame(n * period_ns, picture)).centres for n, picture in enumerate(pictures())]
        tracker.close()
        times_ns = np.arange(len(centres)) * period_ns
        arrays = {"times_ns": times_ns, "centres": np.array(centres), "parts": np.array(BODY_PARTS)}
        write_arrays(path, arrays, compressed=False)
    return read_arrays(path)["centres"]
