"""Any `PoseModel` as a `PersonModel`: it gets a square of the picture that stays in place while the person is inside.

So a model that remembers its last picture sees no jump; when the square moves, the model is made to forget.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from observer.tracking.people import CLEARLY_SEEN, HIPS, SHOULDERS, Body, Pose, Rgb, SearchArea
from observer.tracking.pose import PoseModel
from observer.tracks import Floats

ROOM = 2.0
"""Side of the square, of the person's height."""
WHOLE = 0.75
"""Share of the picture's short side from which the whole picture is used instead."""
TALL_TORSOS = 3.4
"""A standing person's height, of the distance from the hips to the shoulders."""
FAINT = 0.2
"""Visibility below which a landmark does not count for the person's place."""


class CroppedPeople:
    """A `PersonModel` of a `PoseModel`. Two more methods of the model are used where it has them: `everybody` gives the
    landmarks (33, 3) of each person in a picture; `forget(ms)` makes a model that remembers the last picture forget it.
    """

    def __init__(self, model: PoseModel) -> None:
        self._model = model
        self._area: SearchArea | None = None
        self._ms = 0

    def find(self, rgb: Rgb, area: SearchArea, ms: int) -> Sequence[Body]:
        """As `PersonModel.find`."""
        everybody = getattr(self._model, "everybody", None)
        if everybody is not None:
            people = everybody(area.cut(rgb))
        else:
            landmarks = self._run(rgb, area, ms)
            people = [] if landmarks is None else [landmarks]
        return [body_of(_in_picture(each, area, rgb), (rgb.shape[1], rgb.shape[0])) for each in people]

    def pose(self, rgb: Rgb, body: Body, ms: int) -> Pose | None:
        """As `PersonModel.pose`."""
        height, width = rgb.shape[:2]
        area = self._area
        if area is None or not _holds(area, body, (width, height)):
            area = square_about(body, (width, height))
        landmarks = self._run(rgb, area, ms)
        if landmarks is None:
            return None
        landmarks = _in_picture(landmarks, area, rgb)
        return Pose(landmarks, body_of(landmarks, (width, height)))

    def restart(self) -> None:
        """As `PersonModel.restart`."""
        self._area = None

    def close(self) -> None:
        """As `PersonModel.close`."""
        self._model.close()

    def _run(self, rgb: Rgb, area: SearchArea, ms: int) -> Floats | None:
        """The landmarks as shares of the area; the model sees times that increase."""
        forget = getattr(self._model, "forget", None)
        if area != self._area and forget is not None:
            forget(self._later(ms))
        self._area = area
        return self._model.landmarks(area.cut(rgb), self._later(ms))

    def _later(self, ms: int) -> int:
        self._ms = max(self._ms + 1, ms)
        return self._ms


def square_about(body: Body, size: tuple[int, int]) -> SearchArea:
    """The square for a person, moved into a picture of size (width, height); the whole picture for a large person."""
    side = round(body.height * ROOM)
    if side * WHOLE >= min(size) or body.height >= WHOLE * min(size):
        return SearchArea(0, 0, *size)
    side = min(side, *size)
    left, top = (round(min(max(c - side / 2, 0), most - side)) for c, most in zip((body.u, body.v), size, strict=True))
    return SearchArea(left, top, side, side)


def _holds(area: SearchArea, body: Body, size: tuple[int, int]) -> bool:
    """Whether the person is well inside the area, and neither too small nor too large for it."""
    if (area.width, area.height) == size:
        return square_about(replace(body, height=body.height * 1.2), size) == area
    share = body.height / area.width
    margin = body.height / 2
    inside = all(
        (low <= 0 or c - low >= margin) and (low + length >= most or low + length - c >= margin)
        for c, low, length, most in (
            (body.u, area.left, area.width, size[0]),
            (body.v, area.top, area.height, size[1]),
        )
    )
    return inside and 0.6 / ROOM <= share <= 1.5 / ROOM


def body_of(landmarks: Floats, size: tuple[int, int]) -> Body:
    """Where landmarks (33, 3), as shares of a picture of that size, say that a person is.

    The height is the greatest of what the torso, the shoulders and the landmarks that are seen say.
    """
    px = landmarks[:, :2] * np.array(size, dtype=np.float64)
    clear = landmarks[:, 2] >= CLEARLY_SEEN
    if clear.sum() < 2:
        clear = landmarks[:, 2] >= FAINT
    if clear.sum() < 2:
        clear = np.ones(len(landmarks), np.bool_)
    extent = np.ptp(px[clear], axis=0)
    shoulders, hips = px[list(SHOULDERS)], px[list(HIPS)]
    known = bool((landmarks[[*SHOULDERS, *HIPS], 2] >= FAINT).all())
    torso = float(np.linalg.norm(shoulders.mean(axis=0) - hips.mean(axis=0))) if known else 0.0
    across = float(np.linalg.norm(shoulders[0] - shoulders[1]))
    u, v = hips.mean(axis=0) if known else px[clear].mean(axis=0)
    return Body(float(u), float(v), max(float(extent.max()), TALL_TORSOS * torso, TALL_TORSOS * across, 1.0))


def _in_picture(landmarks: Floats, area: SearchArea, rgb: Rgb) -> Floats:
    """Shares of the area -> shares of the whole picture."""
    height, width = rgb.shape[:2]
    shares = landmarks.copy()
    shares[:, 0] = (area.left + landmarks[:, 0] * area.width) / width
    shares[:, 1] = (area.top + landmarks[:, 1] * area.height) / height
    return shares
