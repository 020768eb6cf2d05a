"""All body parts of a person from several cameras' tracks: triangulated, with left and right put right. Pure."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common import SECOND_NS
from observer.calibration.triangulate import GATE_PX
from observer.geometry.projection import project
from observer.recording.reconstruction import (
    CameraTracks,
    Reconstruction,
    common_instants,
    px_per_m,
    reconstruct,
    resample_tracks,
)
from observer.tracks import Floats, other_side


def pairs_in(body_parts: Sequence[str]) -> list[tuple[int, int]]:
    """The rows of left and right parts, left_hand and right_hand and so on."""
    others = enumerate(other_side(body_parts))
    return [(row, other) for row, other in others if body_parts[row].startswith("left_") and other != row]


def exchanged_back(
    matrices: Sequence[Floats], centres: Floats, positions: Floats, pairs: Sequence[tuple[int, int]], gate_px: float
) -> tuple[Floats, NDArray[np.int64]]:
    """Centres (K, P, N, 2) and positions (K, P, 3) -> the centres with left and right put right, and counts (N,).

    A camera has exchanged a pair of parts at an instant if the squared distances of both centres from the images of
    the positions, each at most `gate_px`, sum to less by more than gate_px² when they are exchanged. The counts are the
    pairs that each camera had exchanged.
    """
    result, counts = centres.copy(), np.zeros(len(matrices), dtype=np.int64)
    for n, matrix in enumerate(matrices):
        image = project(matrix, positions)
        for left, right in pairs:
            pair = centres[:, [left, right], n]
            straight, crossed = (_cost(pair[:, rows], image[:, [left, right]], gate_px) for rows in ([0, 1], [1, 0]))
            wrong = straight - crossed > gate_px**2
            result[wrong, left, n], result[wrong, right, n] = pair[wrong, 1], pair[wrong, 0]
            counts[n] += int(wrong.sum())
    return result, counts


def _cost(centres: Floats, image: Floats, gate_px: float) -> Floats:
    """(K, 2, 2) twice -> (K,) sum of the squared distances, each at most gate_px²; NaN where one is not known."""
    cost: Floats = np.minimum(((centres - image) ** 2).sum(axis=-1), gate_px**2).sum(axis=-1)
    return cost


MOST_INSTANTS_HZ = 240.0
"""More instants a second than cameras have only cost time."""
PALM_M = 0.08
"""A palm's width, and twice the usual distance between a joint in space and where a pose model sees it."""


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
    """Pictures a second of the fastest camera, by its median interval, at most MOST_INSTANTS_HZ; 0 for one picture."""
    intervals = [np.median(np.diff(camera.at_ns)) for camera in tracks if len(camera.at_ns) > 1]
    fastest = min((float(interval) for interval in intervals if interval > 0), default=np.inf)
    return min(SECOND_NS / fastest, MOST_INSTANTS_HZ)


def reconstruct_parts(
    tracks: Sequence[CameraTracks],
    body_parts: Sequence[str],
    rate_hz: float,
    gate_px: float | None = None,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> ReconstructedParts:
    """The positions of all parts at this rate; raises BadInput when at no time two cameras deliver.

    gate_px: None is GATE_PX, or PALM_M where the person is if that is more. Cameras whose left and right the positions
    contradict are corrected, and count in a second reconstruction.
    """
    at_ns = common_instants(tracks, rate_hz)
    cameras = [camera for camera in tracks if len(camera.at_ns)]
    matrices = tuple(camera.matrix for camera in cameras)
    centres = np.stack([resample_tracks(camera, at_ns) for camera in cameras], axis=2)
    gate = GATE_PX if gate_px is None else gate_px
    result, pairs = reconstruct(matrices, centres, gate, progress), pairs_in(body_parts)
    if gate_px is None and (palm_px := _palm_px(matrices, result)) > gate:
        gate, result = palm_px, reconstruct(matrices, centres, palm_px, progress)
    corrected, exchanged = exchanged_back(matrices, centres, result.positions, pairs, gate)
    if exchanged.any():
        result = reconstruct(matrices, corrected, gate, progress)
    return ReconstructedParts(result, tuple(camera.name for camera in cameras), matrices, tuple(pairs), exchanged)


def _palm_px(matrices: Sequence[Floats], result: Reconstruction) -> float:
    """PALM_M in the cameras' pictures, median over all positions; 0 without one."""
    scales = px_per_m(matrices, result.positions)
    known = scales[np.isfinite(scales)]
    return PALM_M * float(np.median(known)) if len(known) else 0.0
