"""From what several cameras saw at the same instants to positions in space; pure."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.calibration.triangulate import GATE_PX, triangulate
from observer.tracks import Floats

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True, eq=False)
class Rebuilt:
    """K instants, P parts, N cameras.

    positions: (K, P, 3) metres in the calibration's room, NaN where no two cameras agree. used: (K, P, N) the cameras
    that each rests on. seen: (K, P, N) the cameras that saw it. errors_px: (K, P, N) how far each saw it from where it
    is, NaN where it did not or there is no position.
    """

    positions: Floats
    used: NDArray[np.bool_]
    seen: NDArray[np.bool_]
    errors_px: Floats


def rebuilt(
    matrices: Sequence[Floats], centres: Floats, gate_px: float = GATE_PX, progress: Progress = lambda *_: None
) -> Rebuilt:
    """N matrices (3, 4), centres (K, P, N, 2) undistorted px -> the positions, each triangulated from who agrees.

    Raises BadInput for a gate that is not positive.
    """
    count, parts, cameras, _ = centres.shape
    Hs = np.asarray(matrices, dtype=np.float64)
    positions = np.full((count, parts, 3), np.nan)
    used = np.zeros((count, parts, cameras), dtype=np.bool_)
    errors = np.full((count, parts, cameras), np.nan)
    for instant in range(count):
        for part in range(parts):
            found = triangulate(Hs, centres[instant, part], gate_px)
            positions[instant, part], used[instant, part] = found.point, found.used
            errors[instant, part] = found.errors_px
        progress(instant + 1, count)
    return Rebuilt(positions, used, np.logical_and.reduce(np.isfinite(centres), axis=-1), errors)
