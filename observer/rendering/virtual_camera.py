"""Pictures of a performer from a virtual camera; and a frame source that renders recorded motion."""

import threading
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from common.errors import BadInput
from observer.geometry.projection import pinhole_matrix
from observer.geometry.views import View
from observer.motion.archive import Recording
from observer.motion.playback import RecordedMotion
from observer.rendering.body import Stature, pose, stature
from observer.rendering.canvas import NOBODY_VALUE, Canvas, PinholeCamera, draw
from observer.rendering.figure import Appearance, appearance_of, shapes
from observer.rendering.scenery import Scenery, add_noise, background
from observer.tracks import BODY_PARTS, Floats, Frame, Picture

PERFECT = Scenery()
"""A plain wall, a perfect camera."""


class Renderer:
    """Pictures of one performer from one camera; the same arguments give identical pictures on one machine.

    matrix: (3, 4) pinhole camera, metres to pixels. size_px: (width, height). seed: of background, noise, and of the
    appearance where none is given. standing: `stature` of the recording; by default it is taken from each frame
    alone, so that a bending person appears to stand.
    Raises BadInput for a matrix that is not a pinhole camera, a size below 16 px and a negative seed.
    """

    def __init__(
        self,
        matrix: Floats,
        size_px: tuple[int, int] = (640, 480),
        scenery: Scenery | None = None,
        seed: int = 0,
        appearance: Appearance | None = None,
        standing: Stature | None = None,
    ) -> None:
        if min(size_px) < 16:
            raise BadInput(f"size_px = {size_px}: width and height of at least 16 pixels are expected")
        if seed < 0:
            raise BadInput(f"seed = {seed}: 0 or more is expected")
        self._camera, self._size_px, self._seed = PinholeCamera(matrix), size_px, seed
        self._scenery, self._appearance = scenery or PERFECT, appearance or appearance_of(seed)
        self._standing = standing

    def picture(self, positions: Floats, frame_number: int) -> Picture:
        """(P, 3) left hand, right hand, head in metres, NaN for parts that are not drawn -> (H, W, 3) BGR."""
        canvas = self._drawn(np.asarray(positions, dtype=np.float64))
        return add_noise(canvas.picture, self._scenery, self._seed, frame_number)

    def _drawn(self, positions: Floats) -> Canvas:
        """The figure in front of its background."""
        if positions.shape != (len(BODY_PARTS), 3):
            raise BadInput(f"positions of shape {positions.shape}: ({len(BODY_PARTS)}, 3) is expected")
        width, height = self._size_px
        scene = background(self._scenery.background, self._size_px, self._seed).copy()
        canvas = Canvas(scene, np.full((height, width), NOBODY_VALUE, np.uint8))
        body = pose(positions, self._standing or stature(positions[None]))
        if body is not None:
            draw(canvas, self._camera, shapes(body, self._appearance), self._appearance)
        return canvas


DISTANCE = 3.5
"""Metres from the camera to the middle of the performer."""
FOCAL_HEIGHTS = 1.35
"""Focal length in picture heights: from DISTANCE it shows 2.6 m, a person with raised hands."""


def aimed_matrix(view: View, standing: Stature, size_px: tuple[int, int] = (640, 480)) -> Floats:
    """(3, 4) pinhole camera aimed at the middle of the performer from the direction of a view (door, yaw:45).

    The matrix of a camera file is returned unchanged.
    """
    if view.matrix[2, :3].any():
        return view.matrix
    yaw_rad, pitch_rad = _direction(view.matrix)
    centre_px = ((size_px[0] - 1) / 2, (size_px[1] - 1) / 2)
    return pinhole_matrix(yaw_rad, pitch_rad, DISTANCE, FOCAL_HEIGHTS * size_px[1], centre_px, tuple(standing.middle))


def _direction(parallel: Floats) -> tuple[float, float]:
    """Yaw and pitch of a parallel matrix, whose rows are the picture's right and down (see geometry.projection)."""
    right, down = parallel[0, :3], parallel[1, :3]
    yaw_rad = float(np.arctan2(-right[2], -right[0]))
    backward = down @ [np.sin(yaw_rad), 0.0, -np.cos(yaw_rad)]
    return yaw_rad, float(np.arctan2(backward, -down[1]))


@dataclass(frozen=True, slots=True)
class VirtualCamera:
    """Renders the frames of `motion` at the same times; `Frame.content` is a picture (H, W, 3) uint8 BGR.

    The camera stands in the direction of `view` and is aimed at the performer of each recording. seed: of background
    and noise. The appearance follows from the subject's name, so that all cameras show the same person.
    """

    motion: RecordedMotion
    view: View
    size_px: tuple[int, int] = (640, 480)
    scenery: Scenery = PERFECT
    seed: int = 0
    body_parts: ClassVar[Sequence[str]] = BODY_PARTS

    @property
    def rate_hz(self) -> float:
        """Frames per second of motion."""
        return self.motion.rate_hz

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """Each picture, rendered when it is due; ends soon after `stop` is set."""
        rows, renderers = _rows_of(self.motion.body_parts), list[tuple[Recording, Renderer]]()

        def picture(recording: Recording, i: int, number: int) -> Picture:
            if not renderers or renderers[0][0] is not recording:
                renderers[:] = [(recording, self.renderer(recording))]
            return renderers[0][1].picture(recording.positions[i][rows].astype(float), number)

        return self.motion.shown(stop, picture)

    def renderer(self, recording: Recording) -> Renderer:
        """The renderer of a recording."""
        standing = stature(recording.positions[:, _rows_of(self.motion.body_parts)])
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
