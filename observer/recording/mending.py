"""Positions as cameras leave them, mended: spikes taken out, short gaps closed, idle ends cut off; pure."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from observer.tracks import Floats

SPIKE_M, AROUND_S = 0.25, 0.1
"""A part further than this from the median of its places within a tenth of a second was taken for another: a hand that
turns round at 100 m/s², faster than people throw, comes as far."""

SHORT_S = 0.15
"""A gap that a hand at 2 m/s crosses in 30 cm is closed by a straight line; longer ones stay."""

STILL_M_S, OVER_S = 0.25, 0.2
"""A hand slower than this over a fifth of a second rests; measured positions tremble by a third of it."""

MARGIN_S = 0.25
"""So much rest is left before and after the movement."""


def without_spikes(positions: Floats, rate_hz: float) -> Floats:
    """(K, P, 3) -> the same with NaN for a part that is more than SPIKE_M off the median around it.

    A part that is alone within AROUND_S is believed.
    """
    reach = max(1, round(AROUND_S * rate_hz))
    padded = np.pad(positions, ((reach, reach), (0, 0), (0, 0)), constant_values=np.nan)
    around = np.stack([padded[n : n + len(positions)] for n in range(2 * reach + 1)])
    middle = _nanmedian(around)
    off = np.linalg.norm(positions - middle, axis=-1)
    return np.where((off > SPIKE_M)[..., None], np.nan, positions)


def _nanmedian(values: Floats) -> Floats:
    """Median along axis 0; NaN, without numpy's warning, where all are."""
    known = np.isfinite(values).any(axis=0)
    result: Floats = np.nanmedian(np.where(known, values, 0.0), axis=0)
    return np.where(known, result, np.nan)


def closed(positions: Floats, rate_hz: float, longest_s: float = SHORT_S) -> Floats:
    """(K, P, 3) -> the same, gaps of at most `longest_s` between two sightings filled by a straight line."""
    result = positions.copy()
    most = longest_s * rate_hz + 1e-9
    for part in range(positions.shape[1]):
        seen = np.flatnonzero(np.isfinite(positions[:, part]).all(axis=-1))
        for before, after in pairwise(seen):
            if 1 < after - before <= most:
                share = np.arange(1, after - before)[:, None] / (after - before)
                ends = positions[before, part], positions[after, part]
                result[before + 1 : after, part] = (1 - share) * ends[0] + share * ends[1]
    return result


def moving_span(positions: Floats, hands: list[int], rate_hz: float) -> tuple[int, int]:
    """(K, P, 3) and which parts are hands -> first and past-last instant of the movement, with MARGIN_S of rest.

    All of it when no hand ever moves.
    """
    reach = max(1, round(OVER_S / 2 * rate_hz))
    way = np.linalg.norm(positions[2 * reach :, hands] - positions[: -2 * reach, hands], axis=-1)
    fast: NDArray[np.bool_] = (way > STILL_M_S * 2 * reach / rate_hz).any(axis=1)
    if not fast.any():
        return 0, len(positions)
    moving, margin = np.flatnonzero(fast) + reach, round(MARGIN_S * rate_hz)
    return max(0, int(moving[0]) - margin), min(len(positions), int(moving[-1]) + margin + 1)
