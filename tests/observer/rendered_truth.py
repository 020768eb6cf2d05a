"""The ground truth of a rendered picture: where each part is, and how much of its outline is visible."""

from dataclasses import dataclass

import numpy as np

from observer.rendering.body import pose, stature
from observer.rendering.canvas import NEAREST, NOBODY_VALUE
from observer.rendering.figure import SkinEllipsoid, shapes
from observer.tracks import BODY_PARTS


@dataclass(frozen=True)
class Truth:
    """centres: (P, 2) px, NaN for a part that is not visible. shares: (P,) visible share of each part's outline."""

    centres: np.ndarray
    shares: np.ndarray

    def visible(self, share=0.3):
        return self.shares >= share


def visible_truth(renderer, positions):
    """As `Renderer.picture`, before noise."""
    canvas = renderer._drawn(positions)
    parts = np.arange(len(BODY_PARTS))
    counts = np.bincount(canvas.owner.ravel(), minlength=NOBODY_VALUE + 1)[parts]
    shares = np.minimum(counts / np.maximum(outline_areas(renderer, positions), 1.0), 1.0)
    pixels, depth = renderer._camera.project(np.nan_to_num(positions))
    visible = (counts > 0) & (depth > NEAREST)
    return Truth(np.where(visible[:, None], pixels, np.nan), np.where(visible, shares, 0.0))


def outline_areas(renderer, positions):
    """(P,) area in px of each part without occlusion; 0 where it is unknown or behind the camera."""
    areas = np.zeros(len(BODY_PARTS))
    body = pose(positions, renderer._standing or stature(positions[None]))
    for shape in shapes(body, renderer._appearance) if body is not None else ():
        if isinstance(shape, SkinEllipsoid):
            areas[shape.part] = outline_area(renderer._camera, shape.centre, shape.axes)
    return areas


def outline_area(camera, centre, axes):
    if camera.project(centre[None])[1][0] < NEAREST:
        return 0.0
    return np.pi / np.sqrt(np.linalg.det(camera.conic(centre, axes)[3]))
