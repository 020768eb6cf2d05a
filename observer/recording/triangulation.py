"""From several cameras' tracks to points in space, without the cameras that disagree with the rest, and with left and
right put right; pure."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from common import SECOND_NS
from common.errors import BadInput
from observer.geometry.projection import oriented, project
from observer.recording.reconstruction import CameraTracks, common_instants, resample_tracks
from observer.tracks import Floats, other_side

GATE_PX = 20.0
"""Gate for the reprojection error of a camera: twice the error of trackers in pictures 1000 to 2000 px high."""
MOST_GAUSS_NEWTON_STEPS = 10
"""Most Gauss-Newton steps; three are usual from the linear solution."""


@dataclass(frozen=True, slots=True, eq=False)
class TriangulatedPoints:
    """points: (M, 3) metres, NaN when no two cameras agree. used: (M, N) the inlier cameras.

    errors_px: (M, N) reprojection error of each camera; NaN where it did not see the point, or without a point.
    """

    points: Floats
    used: NDArray[np.bool_]
    errors_px: Floats


def triangulate_all(
    matrices: Sequence[Floats] | Floats, pixels: Floats, gate_px: float = GATE_PX
) -> TriangulatedPoints:
    """(N, 3, 4) projective matrices, (M, N, 2) undistorted pixels (NaN: not seen) -> M points.

    Every pair of cameras proposes a point; the proposal with most cameras within `gate_px` wins, the smaller error
    decides a tie. Its inliers give the linear solution (Hartley and Zisserman, section 12.2), refined by Gauss-Newton
    to the least squared reprojection error. Three cameras reveal one wrong camera; two that disagree give no point.
    Raises BadInput for shapes that do not match and for a gate that is not positive.
    """
    Hs, pixels = np.asarray(matrices, dtype=np.float64), np.asarray(pixels, dtype=np.float64)
    if Hs.ndim != 3 or Hs.shape[1:] != (3, 4) or pixels.ndim != 3 or pixels.shape[1:] != (len(Hs), 2):
        raise BadInput(
            f"matrices {Hs.shape}, pixels {pixels.shape}: (N, 3, 4) and (M, N, 2) are needed, one row per camera"
        )
    if not gate_px > 0:
        raise BadInput(f"gate_px = {gate_px:g}: a distance in pixels above 0, e.g. {GATE_PX:g}")
    Hs = np.array([oriented(H) for H in Hs])
    used = _inliers(Hs, pixels, gate_px)
    known = used.sum(axis=1) >= 2
    used[~known] = False
    points = np.full((len(pixels), 3), np.nan)
    if known.any():
        points[known] = _refined(_linear_points(Hs, pixels[known], used[known]), Hs, pixels[known], used[known])
    return TriangulatedPoints(points, used, _errors(Hs, pixels, points))


def _linear_points(Hs: Floats, pixels: Floats, used: NDArray[np.bool_]) -> Floats:
    """(N, 3, 4), (M, N, 2), (M, N) -> (M, 3) the points with the least algebraic error in the cameras `used`.

    Two rows per camera: u h3·X = h1·X and v h3·X = h2·X, each scaled to length 1, so that the scale of a matrix does
    not weight its camera. A point may be infinite.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        rows = pixels[..., None] * Hs[:, 2:3] - Hs[:, :2]
        rows = np.where(used[..., None, None], rows / np.linalg.norm(rows[..., :3], axis=-1, keepdims=True), 0.0)
        X = np.linalg.svd(rows.reshape(len(pixels), -1, 4), full_matrices=False)[2][:, -1]
        points: Floats = X[:, :3] / X[:, 3:]
    return points


def _inliers(Hs: Floats, pixels: Floats, gate_px: float) -> NDArray[np.bool_]:
    """(M, N) the largest set of cameras that agree with the point of one pair; all False where there is none."""
    best, least = np.zeros(pixels.shape[:2], dtype=np.bool_), np.full(len(pixels), np.inf)
    usable = np.isfinite(pixels[..., 0] + pixels[..., 1]) & np.array([H.any() for H in Hs], dtype=np.bool_)
    for pair in map(list, combinations(range(len(Hs)), 2)):
        rows = np.flatnonzero(usable[:, pair[0]] & usable[:, pair[1]])
        if not len(rows):
            continue
        used = np.zeros((len(rows), len(Hs)), dtype=np.bool_)
        used[:, pair] = True
        errors = _errors(Hs, pixels[rows], _linear_points(Hs, pixels[rows], used))
        # NaN compares false: a camera without the point, or with the point behind it, does not agree.
        agree = errors <= gate_px
        count = agree.sum(axis=1)
        total = np.where(agree, errors**2, 0.0).sum(axis=1) / np.maximum(count, 1)
        fewer, as_many = best[rows].sum(axis=1) < count, best[rows].sum(axis=1) == count
        better = agree[:, pair[0]] & agree[:, pair[1]] & (fewer | (as_many & (total < least[rows])))
        best[rows[better]], least[rows[better]] = agree[better], total[better]
    return best


def _errors(Hs: Floats, pixels: Floats, points: Floats) -> Floats:
    """(M, N) px; NaN where the camera does not see the point or the point is behind it."""
    errors: Floats = np.linalg.norm(np.stack([project(H, points) for H in Hs], axis=1) - pixels, axis=-1)
    return errors


def _refined(points: Floats, Hs: Floats, pixels: Floats, used: NDArray[np.bool_]) -> Floats:
    """(M, 3) the points after Gauss-Newton steps on the reprojection error, each while its steps lower it."""
    points, cost = points.copy(), _cost(points, Hs, pixels, used)
    active = np.arange(len(points))
    for _ in range(MOST_GAUSS_NEWTON_STEPS):
        moved = points[active] + _step(points[active], Hs, pixels[active], used[active])
        moved_cost = _cost(moved, Hs, pixels[active], used[active])
        lower = moved_cost < cost[active]
        active = active[lower]
        if not len(active):
            break
        points[active], cost[active] = moved[lower], moved_cost[lower]
    return points


def _step(points: Floats, Hs: Floats, pixels: Floats, used: NDArray[np.bool_]) -> Floats:
    """(M, 3) the Gauss-Newton step of each point."""
    image = np.einsum("nij,mj->mni", Hs[:, :, :3], points) + Hs[:, :, 3]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        depth = image[..., 2:]
        slopes = (Hs[:, :2, :3] - (image[..., :2] / depth)[..., None] * Hs[:, 2:, :3]) / depth[..., None]
        residuals = pixels - image[..., :2] / depth
    slopes, residuals = np.where(used[..., None, None], slopes, 0.0), np.where(used[..., None], residuals, 0.0)
    finite = np.isfinite(slopes).all(axis=(1, 2, 3)) & np.isfinite(residuals).all(axis=(1, 2))
    step = np.full(points.shape, np.nan)
    rows = slopes[finite].reshape(int(finite.sum()), -1, 3)
    step[finite] = np.einsum("mij,mj->mi", np.linalg.pinv(rows), residuals[finite].reshape(len(rows), -1))
    return step


def _cost(points: Floats, Hs: Floats, pixels: Floats, used: NDArray[np.bool_]) -> Floats:
    """(M,) sum of the squared errors of the cameras `used`; NaN where one does not see the point."""
    cost: Floats = np.where(used, _errors(Hs, pixels, points) ** 2, 0.0).sum(axis=1)
    return cost


BLOCK = 500
"""Instants that are triangulated at once."""


Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True, eq=False)
class Reconstruction:
    """K instants, P parts, N cameras.

    positions: (K, P, 3) metres in the room of the calibration, NaN where no two cameras agree. inliers, observed:
    (K, P, N) the cameras that agree with the position, and those that saw the part. errors_px: (K, P, N) reprojection
    errors, NaN without observation or position.
    """

    positions: Floats
    inliers: NDArray[np.bool_]
    observed: NDArray[np.bool_]
    errors_px: Floats


def reconstruct(
    matrices: Sequence[Floats], centres: Floats, gate_px: float = GATE_PX, progress: Progress = lambda *_: None
) -> Reconstruction:
    """N matrices (3, 4), centres (K, P, N, 2) undistorted px -> triangulated positions.

    Raises BadInput for a gate that is not positive.
    """
    count, parts, cameras, _ = centres.shape
    blocks = []
    for begin in range(0, count, BLOCK):
        block = centres[begin : begin + BLOCK].reshape(-1, cameras, 2)
        blocks.append(triangulate_all(matrices, block, gate_px))
        progress(min(begin + BLOCK, count), count)
    positions = np.concatenate([block.points for block in blocks]).reshape(count, parts, 3)
    inliers = np.concatenate([block.used for block in blocks]).reshape(count, parts, cameras)
    errors = np.concatenate([block.errors_px for block in blocks]).reshape(count, parts, cameras)
    return Reconstruction(positions, inliers, np.logical_and.reduce(np.isfinite(centres), axis=-1), errors)


STEP_M = 1e-3
"""Step of the difference quotient from metres to pixels."""


def px_per_m(matrices: Sequence[Floats], positions: Floats) -> Floats:
    """(K, P, 3) -> (K, P) how many pixels a metre is there: the largest of three directions, mean over the cameras."""
    scales = []
    for matrix in matrices:
        image = project(matrix, positions)
        steps = [np.linalg.norm(project(matrix, positions + step) - image, axis=-1) for step in STEP_M * np.eye(3)]
        scales.append(np.max(steps, axis=0) / STEP_M)
    mean: Floats = np.mean(scales, axis=0)
    return mean


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
            straight, crossed = (
                _capped_cost(pair[:, rows], image[:, [left, right]], gate_px) for rows in ([0, 1], [1, 0])
            )
            wrong = straight - crossed > gate_px**2
            result[wrong, left, n], result[wrong, right, n] = pair[wrong, 1], pair[wrong, 0]
            counts[n] += int(wrong.sum())
    return result, counts


def _capped_cost(centres: Floats, image: Floats, gate_px: float) -> Floats:
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
