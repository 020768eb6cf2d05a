"""Smooths triangulated positions over time where the cameras' own errors are larger than what that costs. Pure."""

from collections.abc import Sequence

import numpy as np

from observer.geometry.projection import Floats
from observer.recording.reconstruction import Reconstruction, px_per_m

AROUND_S = 0.1
"""A position is replaced by the parabola through those within AROUND_S: a low pass of 6 Hz at 60 Hz, the usual limit of
human movement (Winter, Biomechanics and Motor Control of Human Movement, 2009, section 3.4.4)."""
ORDER = 2
EXACT_M = 0.003
"""Parts whose tracks are more exact than this are left as they are: the parabola cuts about as much off the turns of a
hand that waves by 25 cm twice a second."""


def noise_m(matrices: Sequence[Floats], result: Reconstruction) -> Floats:
    """(P,) the standard error of one camera's track of each part, in metres where the part is; 0 where unknown.

    The median over the instants; 2n - 3 degrees of freedom are left from n cameras.
    """
    squares = np.where(result.inliers, result.errors_px, 0.0) ** 2
    count = result.inliers.sum(axis=2)
    noise_px = np.sqrt(squares.sum(axis=2) / np.maximum(2 * count - 3, 1))
    noise = np.where(count >= 2, noise_px / px_per_m(matrices, result.positions), np.nan)
    return np.array(
        [np.median(of_part[np.isfinite(of_part)]) if np.isfinite(of_part).any() else 0.0 for of_part in noise.T]
    )


def smoothed(positions: Floats, rate_hz: float, noise: Floats) -> Floats:
    """(K, P, 3) and (P,) m -> (K, P, 3) smoothed over time by a Savitzky-Golay filter; NaN stays.

    Parts whose noise is below EXACT_M, runs between gaps that are shorter than the filter, and rates below 20 Hz, for
    which it has three positions only, are left as they are.
    """
    from scipy.signal import savgol_filter

    reach = int(AROUND_S * rate_hz + 1e-9)
    length, result = 2 * reach + 1, positions.copy()
    if length <= ORDER + 1:
        return result
    for part in np.flatnonzero(noise >= EXACT_M):
        known = np.isfinite(positions[:, part]).all(axis=1)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]).astype(np.int8)))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            if end - begin >= length:
                result[begin:end, part] = savgol_filter(positions[begin:end, part], length, ORDER, axis=0)
    return result
