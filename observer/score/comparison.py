"""Compares a performance with reference takes: limbs and joints, alignment by dynamic time warping, deviations. Pure.

Alignment: Sakoe and Chiba, IEEE Transactions on Acoustics, Speech, and Signal Processing 26, 1978, symmetric form, over
the whole of both:

    D(i, j) = min(D(i - 1, j) + d(i, j), D(i, j - 1) + d(i, j), D(i - 1, j - 1) + 2 d(i, j))     mean: D(F, G) / (F + G)
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.model.nearest_take import next_sums
from observer.tracks import Floats, Floats32, Integers

SCORED_LIMBS = {
    "left arm": ("left_hand", "left_elbow", "left_shoulder"),
    "right arm": ("right_hand", "right_elbow", "right_shoulder"),
    "left leg": ("left_foot", "left_knee", "left_hip"),
    "right leg": ("right_foot", "right_knee", "right_hip"),
    "trunk": ("head", "neck", "pelvis"),
}
JOINTS = {
    "elbow": ("shoulder", "elbow", "hand"),
    "knee": ("hip", "knee", "foot"),
    "shoulder": ("elbow", "shoulder", "hip"),
    "hip": ("knee", "hip", "shoulder"),
}
"""Between which three parts of one side: the angle is at the second."""


class Limb(NamedTuple):
    """A limb, and the indices of those of its parts that there are."""

    name: str
    parts: tuple[int, ...]


class LimbJoint(NamedTuple):
    """`left knee`, its limb, and the indices of the three parts."""

    name: str
    limb: str
    parts: tuple[int, int, int]


def limbs_of(body_parts: Sequence[str]) -> tuple[Limb, ...]:
    """The limbs of which at least one part is tracked."""
    place = {name: n for n, name in enumerate(body_parts)}
    limbs = (Limb(name, tuple(place[part] for part in parts if part in place)) for name, parts in SCORED_LIMBS.items())
    return tuple(limb for limb in limbs if limb.parts)


def joints_of(body_parts: Sequence[str]) -> tuple[LimbJoint, ...]:
    """The joints whose three parts are tracked."""
    place = {name: n for n, name in enumerate(body_parts)}
    joints = []
    for side in ("left", "right"):
        for name, parts in JOINTS.items():
            first, middle, last = (place.get(f"{side}_{part}", -1) for part in parts)
            if min(first, middle, last) >= 0:
                limb = f"{side} {'arm' if name in ('elbow', 'shoulder') else 'leg'}"
                joints.append(LimbJoint(f"{side} {name}", limb, (first, middle, last)))
    return tuple(joints)


def places_of(trace: Floats32) -> Floats32:
    """(F, 2 P + 3) trace -> (F, P, 2) where each part is, from where the body was in the first frame; body sizes."""
    path = trace[:, None, -3:-1] - trace[0, -3:-1]
    return (trace[:, :-3].reshape(len(trace), -1, 2) + path).astype(np.float32)


def angles_of(places: Floats32, joints: Sequence[LimbJoint]) -> Floats:
    """(F, P, 2) places -> (F, J) degrees of the joints as this view sees them: 180 is straight."""
    angles = np.empty((len(places), len(joints)))
    for n, joint in enumerate(joints):
        first, middle, last = (places[:, part].astype(np.float64) for part in joint.parts)
        one, other = first - middle, last - middle
        cross = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
        angles[:, n] = np.degrees(np.abs(np.arctan2(cross, (one * other).sum(axis=1))))
    return angles


class Alignment:
    """A performance (F, P, 2) beside K takes (G_k, P, 2), places in body sizes.

    distances: (K,) mean distance along the best path, of root mean squares over all parts.
    """

    def __init__(self, performance: Floats32, takes: Sequence[Floats32]) -> None:
        self._lengths: NDArray[np.int64] = np.array([len(take) for take in takes])
        frames, width = len(performance), performance.shape[1] * 2
        padded = np.zeros((len(takes), int(self._lengths.max()), width), np.float32)
        for row, take in zip(padded, takes, strict=True):
            row[: len(take)] = take.reshape(len(take), -1)
        flat = performance.reshape(frames, -1).astype(np.float32)
        squares = np.einsum("kgp,kgp->kg", padded, padded)
        cost = squares[None] + (flat**2).sum(axis=1)[:, None, None] - 2 * np.tensordot(flat, padded, (1, 2))
        self._sums = _shortest(np.sqrt(np.maximum(cost, 0.0) / width))
        ends = self._sums[-1, np.arange(len(takes)), self._lengths - 1]
        self.distances: Floats = (ends / (self._lengths + frames)).astype(np.float64)
        self._paths: dict[int, Integers] = {}

    def path(self, take: int) -> Integers:
        """(L, 2) frames of the performance and of a take that belong together, from the first to the last ones."""
        if take not in self._paths:
            self._paths[take] = self._path(take)
        return self._paths[take]

    def _path(self, take: int) -> Integers:
        sums: list[list[float]] = self._sums[:, take].tolist()
        i, j = len(sums) - 1, int(self._lengths[take]) - 1
        steps = [(i, j)]
        while i and j:
            both, own, other = sums[i - 1][j - 1], sums[i - 1][j], sums[i][j - 1]
            i, j = (i - 1, j - 1) if both <= min(own, other) else (i - 1, j) if own <= other else (i, j - 1)
            steps.append((i, j))
        steps += [(n, 0) for n in range(i - 1, -1, -1)] + [(0, n) for n in range(j - 1, -1, -1)]
        return np.array(steps[::-1])


Align = Callable[[Floats32, Sequence[Floats32]], Alignment]
"""Aligns a performance with takes."""


def _shortest(cost: Floats32) -> Floats32:
    """(F, K, G) sums along the shortest paths, of costs of the same shape."""
    sums = np.empty_like(cost)
    sums[0] = np.cumsum(cost[0], axis=1)
    for i in range(1, len(cost)):
        sums[i] = next_sums(sums[i - 1], cost[i])
    return sums


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
    """(D,) deviations from a take, 0 and more, in the groups and the order of WEIGHTS.

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


def weights_of(limbs: Sequence[Limb], joints: Sequence[LimbJoint]) -> Floats:
    """(D,) weights of the columns of `deviations`: the columns of a group share its weight; all sum to 1."""
    axes = sum(2 * len(limb.parts) for limb in limbs)
    counts = {
        "extent": len(limbs), "extent by axis": axes, "range": len(joints), "path": len(limbs), "speed": len(limbs),
        "tempo": 2,
    }  # fmt: skip
    weights = np.concatenate([np.full(count, WEIGHTS[group] / max(count, 1)) for group, count in counts.items()])
    result: Floats = weights / weights.sum()
    return result
