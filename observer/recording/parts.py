"""All body parts of a person from several cameras' tracks: triangulated, with left and right put right. Pure."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common import SECOND_NS
from observer.calibration.triangulate import GATE_PX
from observer.recording.exchanged import exchanged_back, pairs_in
from observer.recording.reconstruction import (
    CameraTracks,
    Reconstruction,
    common_instants,
    reconstruct,
    resample_tracks,
)
from observer.tracks import Floats


@dataclass(frozen=True, slots=True, eq=False)
class ReconstructedParts:
    """The positions, and the N cameras that delivered tracks: their names and matrices.

    pairs: rows of left and right parts. exchanged: (N,) how many pairs each camera had exchanged, over all instants.
    """

    result: Reconstruction
    cameras: tuple[str, ...]
    matrices: tuple[Floats, ...]
    pairs: tuple[tuple[int, int], ...]
    exchanged: NDArray[np.int64]


def camera_rate_hz(tracks: Sequence[CameraTracks]) -> float:
    """Pictures a second of the fastest camera, by the median of its intervals; 0 when none delivered two."""
    intervals = [np.median(np.diff(camera.at_ns)) for camera in tracks if len(camera.at_ns) > 1]
    fastest = min((float(interval) for interval in intervals if interval > 0), default=np.inf)
    return SECOND_NS / fastest


def reconstruct_parts(
    tracks: Sequence[CameraTracks],
    body_parts: Sequence[str],
    rate_hz: float,
    gate_px: float = GATE_PX,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> ReconstructedParts:
    """The positions of all parts at this rate; raises BadInput when at no time two cameras deliver.

    Cameras whose left and right the positions contradict are corrected, and count in a second reconstruction.
    """
    at_ns = common_instants(tracks, rate_hz)
    cameras = [camera for camera in tracks if len(camera.at_ns)]
    matrices = tuple(camera.matrix for camera in cameras)
    centres = np.stack([resample_tracks(camera, at_ns) for camera in cameras], axis=2)
    result, pairs = reconstruct(matrices, centres, gate_px, progress), pairs_in(body_parts)
    corrected, exchanged = exchanged_back(matrices, centres, result.positions, pairs, gate_px)
    if exchanged.any():
        result = reconstruct(matrices, corrected, gate_px, progress)
    return ReconstructedParts(result, tuple(camera.name for camera in cameras), matrices, tuple(pairs), exchanged)
