"""Smooth derivatives of noisy tracks: Savitzky and Golay's filter, its coefficients from least squares. Pure.

Savitzky and Golay, Analytical Chemistry 36 (1964): a polynomial through the frames around an instant, and its
derivatives there. The second and third derivative of unsmoothed positions are mostly noise.
"""

import math
from functools import lru_cache

import numpy as np

from observer.tracks import Floats

DEGREE = 3
"""The lowest degree that has a third derivative."""
WINDOW_S = 0.23
"""Seven frames at 30 Hz: shorter than a stroke of a hand, longer than the trembling of a tracker."""
FEWEST_FRAMES = 5


def window_frames(rate_hz: float) -> int:
    """The odd number of frames that WINDOW_S holds at this rate, at least FEWEST_FRAMES."""
    return max(2 * round((WINDOW_S * rate_hz - 1) / 2) + 1, FEWEST_FRAMES)


@lru_cache(maxsize=16)
def coefficients(frames: int, rate_hz: float) -> Floats:
    """(4, frames): the rows give position, velocity, acceleration and jerk in the middle of so many frames.

    k! times row k of the pseudo-inverse of (t^0 t^1 t^2 t^3), t in seconds from the middle. Per second, per s², per s³.
    """
    t = (np.arange(frames) - (frames - 1) / 2) / rate_hz
    solved, *_ = np.linalg.lstsq(np.vander(t, DEGREE + 1, increasing=True), np.eye(frames), rcond=None)
    rows: Floats = solved * np.array([[float(math.factorial(k))] for k in range(DEGREE + 1)])
    return rows


def derivatives(tracks: Floats, rate_hz: float, frames: int | None = None) -> Floats:
    """(T, P, D) tracks -> (4, T - frames + 1, P, D): position, velocity, acceleration, jerk in each middle.

    A part that is not seen (NaN) in one frame of a window has no derivative there: NaN.
    """
    width = frames or window_frames(rate_hz)
    if len(tracks) < width:
        return np.empty((DEGREE + 1, 0, *tracks.shape[1:]))
    windows = np.lib.stride_tricks.sliding_window_view(tracks, width, axis=0)
    found: Floats = np.moveaxis(windows @ coefficients(width, rate_hz).T, -1, 0)
    return found
