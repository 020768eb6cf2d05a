"""Smooths triangulated positions over time, by no more than the cameras' own errors. Pure."""

from collections.abc import Sequence

import numpy as np

from observer.geometry.projection import Floats, project
from observer.recording.reconstruction import Reconstruction

AROUND_S = 0.1
"""A position is replaced by the parabola through those within AROUND_S: a low pass of 6 Hz at 60 Hz, the usual limit of
human movement (Winter, Biomechanics and Motor Control of Human Movement, 2009, section 3.4.4)."""
ORDER = 2
STANDARD_ERRORS = 2.0
"""Smoothing moves no position by more standard errors: tracks without noise are left as they are."""
STEP_M = 1e-3
"""Step of the difference quotient from metres to pixels."""


def noise_m(matrices: Sequence[Floats], result: Reconstruction) -> Floats:
    """(P,) the standard error of one camera's track of each part, in metres where the part is; 0 where unknown.

    The median over the instants; 2n - 3 degrees of freedom are left from n cameras.
    """
    squares = np.where(result.inliers, result.errors_px, 0.0) ** 2
    count = result.inliers.sum(axis=2)
    noise_px = np.sqrt(squares.sum(axis=2) / np.maximum(2 * count - 3, 1))
    noise = np.where(count >= 2, noise_px / _px_per_m(matrices, result.positions), np.nan)
    return np.array(
        [np.median(of_part[np.isfinite(of_part)]) if np.isfinite(of_part).any() else 0.0 for of_part in noise.T]
    )


def _px_per_m(matrices: Sequence[Floats], positions: Floats) -> Floats:
    """(K, P) how many pixels a metre is at the positions, the largest over three directions, mean over the cameras."""
    scales = []
    for matrix in matrices:
        image = project(matrix, positions)
        steps = [np.linalg.norm(project(matrix, positions + step) - image, axis=-1) for step in STEP_M * np.eye(3)]
        scales.append(np.max(steps, axis=0) / STEP_M)
    mean: Floats = np.mean(scales, axis=0)
    return mean


def smoothed(positions: Floats, rate_hz: float, noise: Floats) -> Floats:
    """(K, P, 3) and (P,) m -> (K, P, 3) smoothed over time by a Savitzky-Golay filter; NaN stays.

    No position moves by more than STANDARD_ERRORS of `noise`. Runs between gaps that are shorter than the filter, and
    rates below 20 Hz, for which it has three positions only, are left as they are.
    """
    from scipy.signal import savgol_filter

    reach = int(AROUND_S * rate_hz + 1e-9)
    length, result = 2 * reach + 1, positions.copy()
    if length <= ORDER + 1:
        return result
    for part in range(positions.shape[1]):
        known = np.isfinite(positions[:, part]).all(axis=1)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]).astype(np.int8)))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            run = positions[begin:end, part]
            if len(run) >= length:
                way = savgol_filter(run, length, ORDER, axis=0) - run
                far = np.linalg.norm(way, axis=1, keepdims=True)
                most = STANDARD_ERRORS * noise[part]
                result[begin:end, part] = run + way * np.minimum(1.0, most / np.maximum(far, 1e-12))
    return result
