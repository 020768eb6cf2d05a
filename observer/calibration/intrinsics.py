"""Intrinsics: focal length, principal point and distortion of one camera, from pictures of a board (Zhang 2000)."""

from dataclasses import dataclass

import cv2
import numpy as np

from common.errors import BadInput
from common.text import plural
from observer.calibration.board import Board
from observer.calibration.detection import BoardDetection, CameraDetections
from observer.geometry.projection import Floats

FEWEST_PICTURES = 4
"""Each picture of a plane gives two equations for four unknowns and the distortion."""
MOST_PICTURES = 40
"""More hardly improve the result (Zhang 2000: 10 are good, 20 very good), and the time grows with their square."""
OUTLIER_PX, OUTLIER_TIMES = 1.0, 3.0
"""A picture with an error above both 1 px and three times the median is an outlier (blur, a hand) and is left out."""


@dataclass(frozen=True, slots=True, eq=False)
class FittedLens:
    """K: (3, 3), distortion: (5,) k1 k2 p1 p2 k3. error_px: root mean square reprojection error of the pictures used.

    errors_px: root mean square by picture number. left_out: numbers of the outliers.
    """

    K: Floats
    distortion: Floats
    error_px: float
    errors_px: dict[int, float]
    left_out: tuple[int, ...] = ()


def fit_lens(camera: CameraDetections, board: Board, most: int = MOST_PICTURES) -> FittedLens:
    """The lens with the least squared reprojection error (by OpenCV), with k3 fixed at 0.

    Raises BadInput when the board is detected in fewer than four pictures or always from the same direction.
    """
    chosen = _spread_evenly(camera.boards, most)
    if len(chosen) < FEWEST_PICTURES:
        raise BadInput(
            f"{camera.name}: board detected in {len(chosen)} of {plural(camera.picture_count, 'picture')}; the lens "
            f"needs {FEWEST_PICTURES}, better 15, tilted in several directions: check --board, or give --lens FILE"
        )
    lens = _fitted(camera, chosen, board)
    good = [s for s in chosen if lens.errors_px[s.number] <= _limit(list(lens.errors_px.values()))]
    if FEWEST_PICTURES <= len(good) < len(chosen):
        left_out = tuple(s.number for s in chosen if s not in good)
        again = _fitted(camera, good, board)
        lens = FittedLens(again.K, again.distortion, again.error_px, again.errors_px, left_out)
    check_plausible(camera, lens.K)
    return lens


def check_plausible(camera: CameraDetections, K: Floats) -> None:
    """Raise BadInput for an implausible focal length or principal point."""
    width, height = camera.image_size_px
    if not (0.2 < K[0, 0] / max(width, height) < 20 and 0 < K[0, 2] < width and 0 < K[1, 2] < height):
        raise BadInput(
            f"{camera.name}: no plausible lens fits (focal length {K[0, 0]:.0f} px); "
            "take pictures with the board tilted in several directions, over the whole picture"
        )


def _limit(errors: list[float]) -> float:
    return max(OUTLIER_PX, OUTLIER_TIMES * float(np.median(errors)))


def _spread_evenly(boards: tuple[BoardDetection, ...], most: int) -> list[BoardDetection]:
    """At most `most` detections, evenly over time."""
    return [boards[n] for n in np.unique(np.linspace(0, len(boards) - 1, min(most, len(boards))).astype(int))]


def _fitted(camera: CameraDetections, chosen: list[BoardDetection], board: Board) -> FittedLens:
    space = [board.points[s.ids].astype(np.float32) for s in chosen]
    image = [s.pixels.astype(np.float32) for s in chosen]
    start = np.eye(3)
    try:
        error, K, distortion, _, _, _, _, each = cv2.calibrateCameraExtended(
            space, image, camera.image_size_px, start, np.zeros(5), flags=cv2.CALIB_FIX_K3
        )
    except cv2.error:
        raise BadInput(
            f"{camera.name}: no lens fits; take pictures with the board tilted in several directions"
        ) from None
    errors = {s.number: float(e) for s, e in zip(chosen, each.ravel(), strict=True)}
    return FittedLens(np.asarray(K, np.float64), np.asarray(distortion, np.float64).ravel(), float(error), errors)
