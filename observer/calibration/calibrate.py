"""Calibrated cameras from board detections, or from points whose positions in the room and the picture are known."""

import csv
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from common.errors import BadInput, reason_of
from common.text import plural
from observer.calibration.board import Board
from observer.calibration.bundle import Optics, RigidTransform
from observer.calibration.calibrated import CalibratedCamera
from observer.calibration.detection import CameraDetections
from observer.calibration.parameters import FittedLens, solve_extrinsics
from observer.geometry.dlt import fit_projective_matrix
from observer.tracks import Floats

HELD = RigidTransform(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))
"""Board to room when the performer holds it in front of the body, upright, printed side forward."""
LYING = RigidTransform(np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]), np.zeros(3))
"""Board to room when it lies at the performer's feet, readable for the performer."""


@dataclass(frozen=True, slots=True, eq=False)
class BoardCalibration:
    """cameras: the result. origin: number of the picture whose board is the room's origin.

    projected: by camera and picture number, (N, 2) px of the projected corners. errors_px: root mean square by camera
    and picture number. time_offset: root mean square time offset of pictures of one number, in frames. back_m:
    distance of the pattern on the board's back from the one on its front. Both are compensated in the result.
    """

    cameras: tuple[CalibratedCamera, ...]
    origin: int
    projected: dict[str, dict[int, Floats]]
    errors_px: dict[str, dict[int, float]]
    time_offset: float
    back_m: float


def from_boards(
    detections: Sequence[CameraDetections],
    lenses: Mapping[str, FittedLens],
    board: Board,
    origin: int | None,
    lying: bool,
    apart: bool,
    adjust: Collection[str] = (),
) -> BoardCalibration:
    """Place cameras. origin: number of a picture, or None for the one that most cameras share.

    lying: the board lies on the floor in that picture, else the performer holds it. apart: pictures of one number were
    not taken at the same time, and each camera is placed by its own picture `origin`. adjust: cameras whose lens is
    refined with the poses when several cameras see the board together.
    Raises BadInput when no camera, or with `apart` some camera, sees the board in that picture, and as
    `solve_extrinsics` does.
    """
    number = _origin(detections, origin, apart)
    board_to_room = LYING if lying else HELD
    cameras: list[CalibratedCamera] = []
    residuals: dict[str, dict[int, Floats]] = {}
    time_offset, back_m = 0.0, 0.0
    for group in [[camera] for camera in detections] if apart else [list(detections)]:
        rig = solve_extrinsics(group, lenses, board, adjust)
        to_room = board_to_room.after(rig.boards[number].inverse)
        residuals |= rig.residuals_px
        time_offset = max(time_offset, rig.time_offset)
        back_m = max(back_m, float(np.linalg.norm(rig.back[:3])))
        for camera in group:
            pose = rig.cameras[camera.name].after(to_room.inverse)
            error_px = _rms(np.concatenate(list(residuals[camera.name].values())))
            cameras.append(_calibrated(camera, rig.lenses[camera.name], pose, error_px, board))
    projected = {c.name: {d.number: d.pixels + residuals[c.name][d.number] for d in c.boards} for c in detections}
    errors = {name: {n: _rms(part) for n, part in parts.items()} for name, parts in residuals.items()}
    return BoardCalibration(tuple(cameras), number, projected, errors, time_offset, back_m)


def _origin(detections: Sequence[CameraDetections], origin: int | None, apart: bool) -> int:
    for camera in detections:
        if not camera.boards:
            pictures = plural(camera.picture_count, "picture")
            raise BadInput(f"{camera.name}: board detected in none of {pictures}; check --board and the light")
    counts = Counter(detection.number for camera in detections for detection in camera.boards)
    number = max(counts, key=lambda n: (counts[n], -n)) if origin is None else origin
    needed = len(detections) if apart else 1
    if counts[number] < needed:
        usable = [str(n) for n in sorted(counts) if counts[n] >= needed][:20]
        raise BadInput(
            f"--origin {number}: {counts[number]} of {plural(len(detections), 'camera')} see the board in that "
            f"picture, {needed} must; choose one of: {', '.join(usable) or 'none'}"
        )
    return number


def _calibrated(
    camera: CameraDetections, optics: Optics, pose: RigidTransform, error_px: float, board: Board
) -> CalibratedCamera:
    size = f"{type(board).__name__.lower()} {board.columns}x{board.rows}, {board.square:g} m"
    provenance = f"{size}, {plural(len(camera.boards), 'picture')}"
    return CalibratedCamera(camera.name, *optics, pose.R, pose.t, camera.image_size_px, error_px, provenance)


def _rms(residuals: Floats) -> float:
    """(N, 2) -> root mean square of the N distances."""
    return float(np.sqrt(np.mean((residuals**2).sum(axis=-1))))


POINT_COLUMNS = ("x", "y", "z", "u", "v")

FEWEST_WITH_LENS = 6
"""Three points determine a pose up to four solutions; six leave some to average over."""


def read_points(path: Path) -> tuple[Floats, Floats]:
    """A CSV file with columns x, y, z (metres) and u, v (pixels) -> (N, 3), (N, 2); raises BadInput naming the line."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            table = csv.DictReader(file)
            if table.fieldnames is None or not set(POINT_COLUMNS) <= {name.strip() for name in table.fieldnames}:
                raise BadInput(f"{path}: its first line must name the columns {','.join(POINT_COLUMNS)}")
            rows = [_row(path, table.line_num, row) for row in table]
    except OSError as error:
        raise BadInput(f"cannot read {path}: {reason_of(error)}; a CSV file x,y,z,u,v is expected") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise BadInput(f"{path}: not a CSV file: {error}") from None
    numbers = np.array(rows, dtype=np.float64).reshape(-1, 5)
    return numbers[:, :3].copy(), numbers[:, 3:].copy()


def from_points(name: str, points: Floats, pixels: Floats, source: str) -> tuple[CalibratedCamera, tuple[str, ...]]:
    """DLT (section II.A), decomposed into intrinsics and extrinsics without distortion; and warnings about the result.

    (N, 3) metres, (N, 2) pixels, N at least 6 and not in a plane. Raises BadInput as `fit_projective_matrix` does.
    """
    fitted = fit_projective_matrix(points, pixels)
    K, R, t = decomposed(fitted.matrix)
    provenance = f"DLT from {len(points)} points of {source}"
    return CalibratedCamera(name, K, np.zeros(0), R, t, None, fitted.error_px, provenance), fitted.warnings


def placed_by_points(camera: CalibratedCamera, points: Floats, pixels: Floats, source: str) -> CalibratedCamera:
    """The camera, whose lens is known, placed by (N, 3) metres and (N, 2) pixels, N at least 6; a plane is enough.

    Raises BadInput for fewer points, for numbers that are not finite and for points that no pose fits.
    """
    if len(points) < FEWEST_WITH_LENS or not (np.isfinite(points).all() and np.isfinite(pixels).all()):
        raise BadInput(f"{source}: {plural(len(points), 'point')}; {FEWEST_WITH_LENS} are needed, all finite")
    # OpenCV rejects arrays that are views of others.
    points, pixels = np.ascontiguousarray(points), np.ascontiguousarray(pixels)
    try:
        ok, turn, move = cv2.solvePnP(points, pixels, camera.K, camera.distortion, flags=cv2.SOLVEPNP_SQPNP)
        turn, move = cv2.solvePnPRefineLM(points, pixels, camera.K, camera.distortion, turn, move)
    except cv2.error:
        ok = False
    if not ok:
        raise BadInput(f"{source}: no pose fits these points; check the pairs, and that they are not in one line")
    R = np.asarray(cv2.Rodrigues(turn)[0], np.float64)
    t = np.asarray(move, np.float64).ravel()
    placed = CalibratedCamera(camera.name, camera.K, camera.distortion, R, t, camera.image_size_px)
    errors_px = np.linalg.norm(placed.pixels(points) - pixels, axis=1)
    if not np.isfinite(errors_px).all():
        behind = plural(int(np.isnan(errors_px).sum()), "point")
        raise BadInput(f"{source}: {behind} would lie behind the camera; check the pairs")
    provenance = f"placed by {len(points)} points of {source}; {camera.provenance}"
    error_px = float(np.sqrt(np.mean(errors_px**2)))
    return CalibratedCamera(camera.name, camera.K, camera.distortion, R, t, camera.image_size_px, error_px, provenance)


def decomposed(matrix: Floats) -> tuple[Floats, Floats, Floats]:
    """(3, 4) projective matrix, w in metres -> K (3, 3), R (3, 3), t (3,) with matrix = K [R | t]."""
    from scipy.linalg import rq

    K, R = rq(matrix[:, :3])
    signs = np.diag(np.sign(np.diag(K)))
    K, R = K @ signs, signs @ R
    t = np.linalg.solve(K, matrix[:, 3])
    return np.asarray(K / K[2, 2], np.float64), np.asarray(R, np.float64), np.asarray(t, np.float64)


def _row(path: Path, line: int, row: dict[str | None, str | None]) -> list[float]:
    cells = {(key or "").strip(): value for key, value in row.items()}
    try:
        return [float(cells[column] or "") for column in POINT_COLUMNS]
    except (TypeError, ValueError):
        raise BadInput(
            f"{path}: line {line}: five numbers x,y,z,u,v are needed; omit points that were not seen"
        ) from None
