"""Intrinsics: what one camera's lens does, from pictures of a board held at several places and angles."""

from dataclasses import dataclass

import cv2
import numpy as np

from common.errors import BadInput
from observer.calibration.board import Board
from observer.calibration.detection import BoardDetection, CameraDetections
from observer.geometry.projection import Floats

FEWEST_PICTURES = 4
"""Each picture of a plane gives two equations for four unknowns and the distortion; fewer do not hold a lens."""

MOST_PICTURES = 40
"""More hardly change the result (Zhang 2000: 10 are good, 20 very good) and cost time with their square."""

OFF_PX, OFF_TIMES = 1.0, 3.0
"""A picture worse than both 1 px and three times the median was seen wrongly (blur, a hand): it is left out."""


@dataclass(frozen=True, slots=True, eq=False)
class FittedLens:
    """K: (3, 3), distortion: (5,) k1 k2 p1 p2 k3. error_px: root mean square over all corners of the pictures used.

    errors_px: by picture number, root mean square of each picture used. left_out: pictures seen wrongly.
    """

    K: Floats
    distortion: Floats
    error_px: float
    errors_px: dict[int, float]
    left_out: tuple[int, ...] = ()


def fit_lens(sightings: CameraDetections, board: Board, most: int = MOST_PICTURES) -> FittedLens:
    """The lens with the least squared reprojection error (Zhang 2000, by OpenCV), k3 held at 0.

    Raises BadInput when the board is seen in fewer than four pictures or always from the same direction.
    """
    chosen = _spread(sightings.seen, most)
    if len(chosen) < FEWEST_PICTURES:
        raise BadInput(
            f"{sightings.name}: board seen in {len(chosen)} of {sightings.looked_at} pictures; the lens needs "
            f"{FEWEST_PICTURES}, better 15, tilted this way and that: check --board, or give --lens FILE"
        )
    lens = _fitted(sightings, chosen, board)
    good = [s for s in chosen if lens.errors_px[s.number] <= _limit(list(lens.errors_px.values()))]
    if FEWEST_PICTURES <= len(good) < len(chosen):
        left_out = tuple(s.number for s in chosen if s not in good)
        again = _fitted(sightings, good, board)
        lens = FittedLens(again.K, again.distortion, again.error_px, again.errors_px, left_out)
    check_sensible(sightings, lens.K)
    return lens


def check_sensible(sightings: CameraDetections, K: Floats) -> None:
    """Raise BadInput for a focal length or a centre that no lens has."""
    width, height = sightings.image_size_px
    if not (0.2 < K[0, 0] / max(width, height) < 20 and 0 < K[0, 2] < width and 0 < K[1, 2] < height):
        raise BadInput(
            f"{sightings.name}: no sensible lens fits (focal length {K[0, 0]:.0f} px); "
            "take pictures with the board tilted this way and that, over the whole picture"
        )


def _limit(errors: list[float]) -> float:
    return max(OFF_PX, OFF_TIMES * float(np.median(errors)))


def _spread(seen: tuple[BoardDetection, ...], most: int) -> list[BoardDetection]:
    """At most so many, evenly over time."""
    return [seen[n] for n in np.unique(np.linspace(0, len(seen) - 1, min(most, len(seen))).astype(int))]


def _fitted(sightings: CameraDetections, chosen: list[BoardDetection], board: Board) -> FittedLens:
    space = [board.points[s.ids].astype(np.float32) for s in chosen]
    image = [s.pixels.astype(np.float32) for s in chosen]
    start = np.eye(3)
    try:
        error, K, distortion, _, _, _, _, each = cv2.calibrateCameraExtended(
            space, image, sightings.image_size_px, start, np.zeros(5), flags=cv2.CALIB_FIX_K3
        )
    except cv2.error:
        raise BadInput(
            f"{sightings.name}: no lens fits; take pictures with the board tilted this way and that"
        ) from None
    errors = {s.number: float(e) for s, e in zip(chosen, each.ravel(), strict=True)}
    return FittedLens(np.asarray(K, np.float64), np.asarray(distortion, np.float64).ravel(), float(error), errors)
