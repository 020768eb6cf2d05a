"""How far a performance deviates from one take, limb by limb: size, path, speed, and tempo of the whole. Pure."""

from collections.abc import Sequence

import numpy as np

from observer.score.limbs import Limb
from observer.tracks import Floats, Floats32, Integers

SMALL_MOVE = 0.1
"""Body sizes, and body sizes per second: smaller movements are a tracker's noise, so that ratios are as of this."""
FAST = 0.9
"""The quantile of the speeds that stands for how fast a limb is: the largest one is often an error."""
DEVIATION_GROUPS = ("extent", "extent by axis", "path", "speed")
WEIGHTS = {"extent": 1.0, "extent by axis": 1.0, "path": 0.25, "speed": 0.25}
"""Chosen with people left out one at a time on UI-PRMD: extent alone .894, both .916, with path, speed and tempo .912;
all alike .894 (area under the curve). Path and speed stay, because other movements err in them."""
TEMPO_WEIGHT = 0.1


def deviations(performance: Floats32, take: Floats32, path: Integers, rate_hz: float, limbs: Sequence[Limb]) -> Floats:
    """(4 L + 2,) deviations from a take, 0 and more: DEVIATION_GROUPS for each limb, then duration and order.

    performance, take: (F, P, 2) places; path: the frames that belong together.
    """
    own, shown = path.T
    apart = performance[own] - take[shown]
    # Where somebody stands, and how they are built, is no error.
    apart = apart - apart.mean(axis=0)
    squares = (apart**2).sum(axis=2)
    extents = [np.ptp(each, axis=0) for each in (performance, take)]
    speeds = [np.linalg.norm(np.gradient(each, axis=0), axis=2) * rate_hz for each in (performance, take)]
    by_axis = _log_ratio(extents[0], extents[1])
    rows = np.empty((len(DEVIATION_GROUPS), len(limbs)))
    for n, limb in enumerate(limbs):
        parts = list(limb.parts)
        widest = [float(np.linalg.norm(each[parts], axis=1).max()) for each in extents]
        fastest = [float(np.quantile(each[:, parts], FAST)) for each in speeds]
        rows[:, n] = (
            _log_ratio(*widest), by_axis[parts].mean(), np.sqrt(squares[:, parts].mean()), _log_ratio(*fastest),
        )  # fmt: skip
    longer = abs(np.log(len(performance) / len(take)))
    order = np.abs(own / max(len(performance) - 1, 1) - shown / max(len(take) - 1, 1)).mean()
    result: Floats = np.concatenate([rows.ravel(), [longer, order]])
    return result


def _log_ratio(one: Floats | float, other: Floats | float) -> Floats:
    ratio: Floats = np.abs(
        np.log((np.asarray(one, np.float64) + SMALL_MOVE) / (np.asarray(other, np.float64) + SMALL_MOVE))
    )
    return ratio


def weights_of(limbs: int) -> Floats:
    """(4 L + 2,) of the deviations, in the same order; they sum to 1."""
    weights = np.repeat([WEIGHTS[group] / limbs for group in DEVIATION_GROUPS], limbs)
    weights = np.append(weights, [TEMPO_WEIGHT / 2] * 2)
    result: Floats = weights / weights.sum()
    return result
