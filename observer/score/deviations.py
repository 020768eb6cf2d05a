"""How far a performance deviates from one take: size, range of the joints, path, speed and tempo. Pure."""

from collections.abc import Sequence

import numpy as np

from observer.score.limbs import Limb, LimbJoint
from observer.tracks import Floats, Floats32, Integers

SMALL_MOVE = 0.1
"""Body sizes, and body sizes per second: smaller movements are a tracker's noise, so that ratios are as of this."""
FAST = 0.9
"""The quantile of the speeds that stands for how fast a limb is: the largest one is often an error."""
WEIGHTS = {"extent": 1.0, "extent by axis": 1.0, "range": 1.0, "path": 0.25, "speed": 0.25, "tempo": 0.1}
"""All alike but for three, chosen with people left out one at a time on UI-PRMD: area under the curve .911, without
these three .915 (docs/results/notebook.md). They stay, because other movements err in them."""


def deviations(
    performance: Floats32, take: Floats32, path: Integers, rate_hz: float, limbs: Sequence[Limb], ranges: Floats
) -> Floats:
    """(D,) deviations from a take, 0 and more, in the order of `columns_of`.

    performance, take: (F, P, 2) places; path: the frames that belong together. ranges: (2, J) degrees, how far each
    joint goes in both.
    """
    own, shown = path.T
    apart = performance[own] - take[shown]
    # Where somebody stands, and how they are built, is no error.
    apart = apart - apart.mean(axis=0)
    squares = (apart**2).sum(axis=2)
    extents = [np.ptp(each, axis=0) for each in (performance, take)]
    speeds = [np.linalg.norm(np.gradient(each, axis=0), axis=2) * rate_hz for each in (performance, take)]
    by_axis = _log_ratio(extents[0], extents[1])
    sizes, paths, fast = list[Floats](), list[float](), list[Floats]()
    for limb in limbs:
        parts = list(limb.parts)
        sizes.append(_log_ratio(*(float(np.linalg.norm(each[parts], axis=1).max()) for each in extents)))
        paths.append(float(np.sqrt(squares[:, parts].mean())))
        fast.append(_log_ratio(*(float(np.quantile(each[:, parts], FAST)) for each in speeds)))
    axes = [by_axis[part] for limb in limbs for part in limb.parts]
    longer = abs(np.log(len(performance) / len(take)))
    order = np.abs(own / max(len(performance) - 1, 1) - shown / max(len(take) - 1, 1)).mean()
    return np.concatenate([sizes, np.ravel(axes), np.abs(ranges[0] - ranges[1]), paths, fast, [longer, order]])


def _log_ratio(one: Floats | float, other: Floats | float) -> Floats:
    return np.abs(np.log((np.asarray(one, np.float64) + SMALL_MOVE) / (np.asarray(other, np.float64) + SMALL_MOVE)))


def columns_of(limbs: Sequence[Limb], joints: Sequence[LimbJoint]) -> list[tuple[str, str]]:
    """The group and the limb of each deviation; tempo is of no limb."""
    each = [limb.name for limb in limbs]
    axes = [limb.name for limb in limbs for _ in limb.parts for _ in range(2)]
    of_group = {
        "extent": each, "extent by axis": axes, "range": [joint.limb for joint in joints], "path": each, "speed": each,
        "tempo": ["", ""],
    }  # fmt: skip
    return [(group, limb) for group, own in of_group.items() for limb in own]


def weights_of(columns: Sequence[tuple[str, str]]) -> Floats:
    """(D,) of these columns: those of a group are alike; they sum to 1."""
    groups = [group for group, _ in columns]
    weights = np.array([WEIGHTS[group] / groups.count(group) for group in groups])
    result: Floats = weights / weights.sum()
    return result
