"""A frame source that renders recorded motion as pictures of a virtual camera."""

import itertools
import threading
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from common.errors import BadInput
from observer.geometry.projection import Floats, pinhole_matrix
from observer.geometry.views import View
from observer.motion.archive import Recording
from observer.motion.playback import RecordedMotion
from observer.rendering.body import Stature, stature
from observer.rendering.figure import appearance_of
from observer.rendering.renderer import Renderer
from observer.rendering.scenery import Scenery
from observer.tracks import BODY_PARTS, Frame

DISTANCE = 3.5
"""Metres from the camera to the middle of the performer."""
FOCAL = 1.35
"""Focal length in picture heights: from DISTANCE it shows 2.6 m, a person with raised hands."""
PERFECT = Scenery()
"""A plain wall, a perfect camera, steady light."""


def aimed_matrix(
    view: View, standing: Stature, size_px: tuple[int, int] = (640, 480), distance: float = DISTANCE
) -> Floats:
    """(3, 4) pinhole camera aimed at the middle of the performer from the direction of a view (door, yaw:45).

    The matrix of a camera file is returned unchanged.
    """
    if view.matrix[2, :3].any():
        return view.matrix
    yaw_rad, pitch_rad = _direction(view.matrix)
    centre_px = ((size_px[0] - 1) / 2, (size_px[1] - 1) / 2)
    return pinhole_matrix(yaw_rad, pitch_rad, distance, FOCAL * size_px[1], centre_px, tuple(standing.middle))


def _direction(parallel: Floats) -> tuple[float, float]:
    """Yaw and pitch of a parallel matrix, whose rows are the picture's right and down (see geometry.projection)."""
    right, down = parallel[0, :3], parallel[1, :3]
    yaw_rad = float(np.arctan2(-right[2], -right[0]))
    backward = down @ [np.sin(yaw_rad), 0.0, -np.cos(yaw_rad)]
    return yaw_rad, float(np.arctan2(backward, -down[1]))


@dataclass(frozen=True, slots=True)
class VirtualCamera:
    """Renders the frames of `motion` at the same times; `Frame.content` is a picture (H, W, 3) uint8 BGR.

    The camera stands in the direction of `view` and is aimed at the performer of each recording. seed: of background,
    light and noise. The appearance follows from the subject's name, so that all cameras show the same person.
    """

    motion: RecordedMotion
    view: View
    size_px: tuple[int, int] = (640, 480)
    scenery: Scenery = PERFECT
    seed: int = 0

    @property
    def rate_hz(self) -> float:
        """Frames per second of motion."""
        return self.motion.rate_hz

    @property
    def body_parts(self) -> Sequence[str]:
        """The parts that the pictures show."""
        return BODY_PARTS

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """Each picture when it is due, or as soon as it is rendered; ends soon after `stop` is set."""
        order = _rows_of(self.motion.archive_parts)
        played = self.motion.frames(stop)
        number = itertools.count()
        recordings = self.motion.recordings
        for recording in itertools.cycle(recordings) if self.motion.loop else recordings:
            renderer = self.renderer(recording)
            before = None
            for frame in itertools.islice(played, len(recording.positions)):
                positions = frame.content[order]
                picture = renderer.picture(positions, next(number), before)
                yield Frame(frame.captured_ns, picture, frame.motion_ns)
                before = positions
            if before is None:  # stopped
                return

    def renderer(self, recording: Recording) -> Renderer:
        """The renderer of a recording; it gives the ground truth for the same positions and frame numbers."""
        standing = stature(recording.positions[:, _rows_of(self.motion.archive_parts)])
        matrix = aimed_matrix(self.view, standing, self.size_px)
        appearance = appearance_of(zlib.crc32(recording.subject.encode()))
        return Renderer(matrix, self.size_px, self.scenery, self.seed, appearance, standing)


def _rows_of(names: Sequence[str]) -> list[int]:
    """Rows of the three parts in the archive; raises BadInput when one is missing."""
    missing = [part for part in BODY_PARTS if part not in names]
    if missing:
        raise BadInput(
            f"body_parts = {list(names)}: {missing[0]} is missing, and the performer cannot be drawn without it"
        )
    return [list(names).index(part) for part in BODY_PARTS]
