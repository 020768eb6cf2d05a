"""Several cameras' tracks at common instants, and the repair of triangulated positions; the performer's axes; pure."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.tracks import Floats

TRACK_GAP_S = 0.2
"""Longest gap that is interpolated in a camera's tracks: in a longer one a hand may have gone there and back."""
SAME_S = 1e-6
"""Instants nearer than this are equal, so that rounding does not require a neighbour that was not seen."""


@dataclass(frozen=True, slots=True, eq=False)
class CameraTracks:
    """The tracks of one camera. matrix: (3, 4). at_ns: (F,) times. centres: (F, P, 2) undistorted px, NaN: not seen.

    complaint: why its tracker finds little, at the end; "" if all is well.
    """

    name: str
    matrix: Floats
    at_ns: NDArray[np.int64]
    centres: Floats
    complaint: str = ""


def common_instants(tracks: Sequence[CameraTracks], rate_hz: float) -> NDArray[np.int64]:
    """(K,) ns at this rate, from the start of the second camera to the end of the last but one.

    Raises BadInput when at no time two cameras deliver.
    """
    silent = [camera.name for camera in tracks if not len(camera.at_ns)]
    cameras = [camera for camera in tracks if len(camera.at_ns)]
    if len(cameras) < 2:
        raise BadInput(f"no pictures from {', '.join(silent)}: at least two cameras must see the performer")
    begin = sorted(int(camera.at_ns[0]) for camera in cameras)[1]
    end = sorted(int(camera.at_ns[-1]) for camera in cameras)[-2]
    if end <= begin:
        names = ", ".join(camera.name for camera in cameras)
        raise BadInput(
            f"{names}: no two of them overlap in time; recorded sources count from "
            "their start and live cameras by the clock, so do not mix them, and use more than one frame"
        )
    return begin + np.round(np.arange(int((end - begin) * rate_hz / 1e9 + 1e-6) + 1) * 1e9 / rate_hz).astype(np.int64)


def resample_tracks(camera: CameraTracks, at_ns: NDArray[np.int64]) -> Floats:
    """(K, P, 2) centres at these instants, by linear interpolation.

    NaN before the first observation of a part, after its last, and in gaps longer than TRACK_GAP_S.
    """
    result = np.full((len(at_ns), *camera.centres.shape[1:]), np.nan)
    # Relative to the first instant, since a float cannot hold nanoseconds since 1970 exactly.
    times, wanted = (camera.at_ns - at_ns[0]) / 1e9, (at_ns - at_ns[0]) / 1e9
    for part in range(camera.centres.shape[1]):
        observed = np.isfinite(camera.centres[:, part]).all(axis=-1)
        if observed.any():
            values = camera.centres[observed, part]
            result[:, part] = _interpolate(times[observed], values, wanted)
    return result


def _interpolate(times: Floats, values: Floats, wanted: Floats) -> Floats:
    """(F,) increasing times, (F, D) values -> (K, D) at the wanted times."""
    after = np.clip(np.searchsorted(times, wanted - SAME_S), 0, len(times) - 1)
    before = np.maximum(after - 1, 0)
    gap = times[after] - times[before]
    exact = np.abs(times[after] - wanted) <= SAME_S
    weight = np.where(exact, 1.0, (wanted - times[before]) / np.where(gap > 0, gap, 1.0))[:, None]
    known = exact | ((gap > 0) & (gap <= TRACK_GAP_S) & (wanted > times[before]) & (wanted < times[after]))
    return np.where(known[:, None], (1 - weight) * values[before] + weight * values[after], np.nan)


SPIKE_M, AROUND_S = 0.25, 0.1
"""A position farther than SPIKE_M from the median within AROUND_S is a tracking error. A hand that reverses with
100 m/s², faster than people throw, comes as far."""
SHORT_S = 0.15
"""Longest gap that is filled by a straight line: a hand at 2 m/s moves 30 cm in it."""
STILL_M_S, OVER_S = 0.25, 0.2
"""A hand slower than STILL_M_S over OVER_S is at rest; measured positions tremble at a third of this speed."""
MARGIN_S = 0.25
"""Rest that is kept before and after the movement."""


def remove_spikes(positions: Floats, rate_hz: float) -> Floats:
    """(K, P, 3) -> the same with NaN for positions farther than SPIKE_M from the median around them.

    A position without neighbours within AROUND_S is kept.
    """
    reach = max(1, round(AROUND_S * rate_hz))
    padded = np.pad(positions, ((reach, reach), (0, 0), (0, 0)), constant_values=np.nan)
    around = np.stack([padded[n : n + len(positions)] for n in range(2 * reach + 1)])
    middle = _nanmedian(around)
    off = np.linalg.norm(positions - middle, axis=-1)
    return np.where((off > SPIKE_M)[..., None], np.nan, positions)


def _nanmedian(values: Floats) -> Floats:
    """Median along axis 0; NaN where all are NaN, without the warning of numpy."""
    known = np.isfinite(values).any(axis=0)
    result: Floats = np.nanmedian(np.where(known, values, 0.0), axis=0)
    return np.where(known, result, np.nan)


def fill_gaps(positions: Floats, rate_hz: float) -> Floats:
    """(K, P, 3) -> the same with gaps of at most SHORT_S filled by straight lines."""
    result = positions.copy()
    most = SHORT_S * rate_hz + 1e-9
    for part in range(positions.shape[1]):
        known = np.flatnonzero(np.isfinite(positions[:, part]).all(axis=-1))
        for before, after in pairwise(known):
            if 1 < after - before <= most:
                share = np.arange(1, after - before)[:, None] / (after - before)
                ends = positions[before, part], positions[after, part]
                result[before + 1 : after, part] = (1 - share) * ends[0] + share * ends[1]
    return result


def moving_span(positions: Floats, hands: list[int], rate_hz: float) -> tuple[int, int]:
    """(K, P, 3) and the rows of the hands -> first and past-the-end instant of the movement, with MARGIN_S of rest.

    The whole recording when no hand ever moves.
    """
    reach = max(1, round(OVER_S / 2 * rate_hz))
    distance = np.linalg.norm(positions[2 * reach :, hands] - positions[: -2 * reach, hands], axis=-1)
    fast: NDArray[np.bool_] = (distance > STILL_M_S * 2 * reach / rate_hz).any(axis=1)
    if not fast.any():
        return 0, len(positions)
    moving, margin = np.flatnonzero(fast) + reach, round(MARGIN_S * rate_hz)
    return max(0, int(moving[0]) - margin), min(len(positions), int(moving[-1]) + margin + 1)


UP_AXES = {
    sign + name: direction * np.eye(3)[n] for n, name in enumerate("xyz") for sign, direction in (("", 1), ("-", -1))
}
"""x, -x, y, -y, z, -z: unit vectors (3,)."""

UP, FRONT = "y", "-z"
"""The axes of `labanmesh camera calibrate`: the room's are the performer's."""


def performer_axes(up: str, front: str) -> Floats:
    """(3, 3) rotation from a room in which `up` points up and the performer faces along `front`.

    Its rows are the performer's right, up and back in the room: right = up x back. Raises BadInput for an unknown axis,
    and for two parallel axes.
    """
    for option, axis in (("--up", up), ("--front", front)):
        if axis not in UP_AXES:
            raise BadInput(f"{option} {axis!r}: not an axis of the room; known: {', '.join(UP_AXES)}")
    if up[-1] == front[-1]:
        others = ", ".join(axis for axis in UP_AXES if axis[-1] != up[-1])
        raise BadInput(f"--front {front!r}: parallel to --up {up!r}; use one of {others}")
    back = -UP_AXES[front]
    return np.array([np.cross(UP_AXES[up], back), UP_AXES[up], back])


def to_performer_axes(positions: NDArray[np.floating], up: str = UP, front: str = FRONT) -> Floats:
    """(..., 3) metres in the room -> (..., 3) in the performer's axes; raises BadInput as `performer_axes` does."""
    return positions @ performer_axes(up, front).T
