"""Puts recorded people where a person will stand in the room of calibrated cameras. Pure.

Archives have axes of their own: x to the performer's right, y up, z to the performer's back. A Kinect's performers
stand 2 to 3 m from its origin and face it. The room of a camera file has the axes of its calibration.
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from observer.geometry.placement import PersonPlacement
from observer.geometry.projection import Floats
from observer.geometry.views import turned
from observer.motion.archive import MotionArchive

UPRIGHT = 90.0
"""Percentile of the head's heights in a recording that is its height while the person stands upright."""


def placed(archive: MotionArchive, placement: PersonPlacement) -> MotionArchive:
    """The archive with each person at `placement`, turned in place.

    Each recording is moved so that the mean place of its head on the floor is the placement's; all of them are raised
    by the same height, which brings the median height of the upright heads to the placement's. Without a part `head`
    the mean of all parts stands for it.
    """
    rows = _head_rows(archive)
    heights = [_upright_m(recording.positions[:, rows]) for recording in archive.recordings]
    known = [height for height in heights if math.isfinite(height)]
    raised_m = placement.head_m - float(np.median(known)) if known else 0.0
    recordings = []
    for recording in archive.recordings:
        centre = _floor_centre(recording.positions, rows)
        step = np.array([placement.x_m - centre[0], raised_m, placement.z_m - centre[2]])
        facing = turned(recording.positions, math.radians(placement.facing_deg), centre)
        recordings.append(replace(recording, positions=(facing + step).astype(np.float32)))
    return replace(archive, recordings=tuple(recordings))


def mean_place(archive: MotionArchive) -> tuple[float, float]:
    """x and z where the archive's people stand, on average over the recordings, m."""
    rows = _head_rows(archive)
    centre = np.mean([_floor_centre(recording.positions, rows) for recording in archive.recordings], axis=0)
    return float(centre[0]), float(centre[2])


def _head_rows(archive: MotionArchive) -> list[int]:
    """The row of the head, or all rows without one."""
    parts = archive.body_parts
    return [parts.index("head")] if "head" in parts else list(range(len(parts)))


def _upright_m(heads: NDArray[np.float32]) -> float:
    """(F, H, 3) -> the height of the upright person's head; NaN if it was never seen."""
    heights = heads[..., 1][np.isfinite(heads).all(axis=-1)]
    return float(np.percentile(heights, UPRIGHT)) if len(heights) else math.nan


def _floor_centre(positions: NDArray[np.float32], rows: list[int]) -> Floats:
    """(3,) the mean of the head, or of all parts where the head was never seen."""
    heads = positions[:, rows]
    points = heads if np.isfinite(heads).all(axis=-1).any() else positions
    centre: Floats = points[np.isfinite(points).all(axis=-1)].mean(axis=0, dtype=np.float64)
    return centre
