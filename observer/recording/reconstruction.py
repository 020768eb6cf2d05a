"""From several cameras' tracks to positions in the performer's axes: resampling, triangulation, repair; pure."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.calibration.triangulate import GATE_PX, triangulate
from observer.tracks import Floats

LONGEST_GAP_S = 0.2
"""A part not seen for longer is not known between: a hand may have gone there and back."""

SAME_S = 1e-6
"""Instants nearer than this are one, so that rounding makes none depend on a neighbour that was not seen."""


@dataclass(frozen=True, slots=True, eq=False)
class CameraTracks:
    """What one camera saw. matrix: (3, 4). at_ns: (F,) when. centres: (F, P, 2) undistorted px, NaN: not seen."""

    name: str
    matrix: Floats
    at_ns: NDArray[np.int64]
    centres: Floats


def instants(sighted: Sequence[CameraTracks], rate_hz: float) -> NDArray[np.int64]:
    """(K,) ns, evenly at this rate, from when a second camera has begun to when a second-last one has ended.

    Raises BadInput when there is no such time, naming who saw nothing.
    """
    blind = [one.name for one in sighted if not len(one.at_ns)]
    known = [one for one in sighted if len(one.at_ns)]
    if len(known) < 2:
        raise BadInput(f"no pictures from {', '.join(blind)}: two cameras at least must see the performer")
    begin = sorted(int(one.at_ns[0]) for one in known)[1]
    end = sorted(int(one.at_ns[-1]) for one in known)[-2]
    if end <= begin:
        raise BadInput(
            f"{', '.join(one.name for one in known)}: no two of them saw the same moment; recordings count from their "
            "beginning and cameras by the clock, so mix none, and let both last longer than one frame"
        )
    return begin + np.round(np.arange(int((end - begin) * rate_hz / 1e9 + 1e-6) + 1) * 1e9 / rate_hz).astype(np.int64)


def sampled(one: CameraTracks, at_ns: NDArray[np.int64], longest_gap_s: float = LONGEST_GAP_S) -> Floats:
    """(K, P, 2) centres at these instants, linear between the two sightings of a part around each.

    NaN before the first, after the last, and where those two are more than `longest_gap_s` apart.
    """
    result = np.full((len(at_ns), *one.centres.shape[1:]), np.nan)
    # From the first instant, as whole nanoseconds since 1970 are more than a float holds.
    times, wanted = (one.at_ns - at_ns[0]) / 1e9, (at_ns - at_ns[0]) / 1e9
    for part in range(one.centres.shape[1]):
        seen = np.isfinite(one.centres[:, part]).all(axis=-1)
        if seen.any():
            result[:, part] = _between(times[seen], one.centres[seen, part], wanted, longest_gap_s)
    return result


def _between(times: Floats, values: Floats, wanted: Floats, longest_gap_s: float) -> Floats:
    """(F,) growing, (F, D) -> (K, D)."""
    after = np.clip(np.searchsorted(times, wanted - SAME_S), 0, len(times) - 1)
    before = np.maximum(after - 1, 0)
    gap = times[after] - times[before]
    exact = np.abs(times[after] - wanted) <= SAME_S
    weight = np.where(exact, 1.0, (wanted - times[before]) / np.where(gap > 0, gap, 1.0))[:, None]
    known = exact | ((gap > 0) & (gap <= longest_gap_s) & (wanted > times[before]) & (wanted < times[after]))
    return np.where(known[:, None], (1 - weight) * values[before] + weight * values[after], np.nan)


Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True, eq=False)
class Reconstruction:
    """K instants, P parts, N cameras.

    positions: (K, P, 3) metres in the calibration's room, NaN where no two cameras agree. used: (K, P, N) the cameras
    that each rests on. seen: (K, P, N) the cameras that saw it. errors_px: (K, P, N) how far each saw it from where it
    is, NaN where it did not or there is no position.
    """

    positions: Floats
    used: NDArray[np.bool_]
    seen: NDArray[np.bool_]
    errors_px: Floats


def reconstruct(
    matrices: Sequence[Floats], centres: Floats, gate_px: float = GATE_PX, progress: Progress = lambda *_: None
) -> Reconstruction:
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
    return Reconstruction(positions, used, np.logical_and.reduce(np.isfinite(centres), axis=-1), errors)


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


AXES = {
    sign + name: direction * np.eye(3)[n] for n, name in enumerate("xyz") for sign, direction in (("", 1), ("-", -1))
}
"""x, -x, y, -y, z, -z: unit vectors (3,)."""

UP, FRONT = "y", "-z"
"""The axes of `labanmesh calibrate`: the room's are the performer's."""


def performer_axes(up: str, front: str) -> Floats:
    """(3, 3) rotation from a room in which `up` points up and the performer faces along `front`.

    Its rows are his right, up and back in the room: right = up x back. Raises BadInput for what is no axis, and for two
    on one line.
    """
    for option, axis in (("--up", up), ("--front", front)):
        if axis not in AXES:
            raise BadInput(f"{option} {axis!r}: no axis of the room; known: {', '.join(AXES)}")
    if up[-1] == front[-1]:
        others = ", ".join(axis for axis in AXES if axis[-1] != up[-1])
        raise BadInput(f"--front {front!r}: on the line of --up {up!r}; he faces along one of {others}")
    back = -AXES[front]
    return np.array([np.cross(AXES[up], back), AXES[up], back])


def to_performer_axes(positions: NDArray[np.floating], up: str = UP, front: str = FRONT) -> Floats:
    """(..., 3) metres in the room -> (..., 3) in the performer's axes; raises BadInput as `performer_axes` does."""
    result: Floats = positions @ performer_axes(up, front).T
    return result
