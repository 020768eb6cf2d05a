"""Calibrated cameras from board detections or from known points."""

import csv
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from common.errors import BadInput
from observer.calibration.board import Board
from observer.calibration.bundle import Optics
from observer.calibration.calibrated import CalibratedCamera
from observer.calibration.detection import CameraDetections
from observer.calibration.extrinsics import RigidTransform, solve_extrinsics
from observer.calibration.intrinsics import FittedLens
from observer.geometry.dlt import fit_projective_matrix
from observer.geometry.projection import Floats

HELD = RigidTransform(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))
"""From the board to the room when the performer holds it before him, upright, printed side forward."""

LYING = RigidTransform(np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]), np.zeros(3))
"""From the board to the room when it lies before the performer's feet, as he would read it."""


@dataclass(frozen=True, slots=True, eq=False)
class BoardResult:
    """cameras: as calibrated. origin: the number of the picture whose board is the room's origin.

    drawn: by camera, by picture number, (N, 2) pixels where the corners should be. errors_px: root mean square of each
    picture, by camera and number. moments: root mean square of how far pictures of one number were apart, in pictures.
    back_m: how far the pattern on the board's back lies from the one in front. Both are accounted for in the rest.
    """

    cameras: tuple[CalibratedCamera, ...]
    origin: int
    drawn: dict[str, dict[int, Floats]]
    errors_px: dict[str, dict[int, float]]
    moments: float
    back_m: float


def from_boards(
    seen: Sequence[CameraDetections],
    lenses: Mapping[str, FittedLens],
    board: Board,
    origin: int | None,
    lying: bool,
    apart: bool,
    adjust: Collection[str] = (),
) -> BoardResult:
    """Place cameras. origin: a picture's number, or None for the one that most cameras share.

    adjust: cameras whose lens is moved with the places, where several cameras see the board together.
    apart: pictures of one number were not taken at the same time; each camera is placed by its own picture `origin`.
    Raises BadInput when no camera, or with `apart` some camera, sees the board in that picture, and as
    `solve_extrinsics` does.
    """
    number = _origin(seen, origin, apart)
    rooms = LYING if lying else HELD
    cameras: list[CalibratedCamera] = []
    off: dict[str, dict[int, Floats]] = {}
    moments, back_m = 0.0, 0.0
    for group in [[s] for s in seen] if apart else [list(seen)]:
        found = solve_extrinsics(group, lenses, board, adjust)
        to_room = rooms.after(found.boards[number].back)
        off |= found.off_px
        moments, back_m = max(moments, found.moments), max(back_m, float(np.linalg.norm(found.back[:3])))
        for s in group:
            pose = found.cameras[s.name].after(to_room.back)
            error_px = _rms(np.concatenate(list(off[s.name].values())))
            cameras.append(_calibrated(s, found.lenses[s.name], pose, error_px, board))
    drawn = {s.name: {shot.number: shot.pixels + off[s.name][shot.number] for shot in s.seen} for s in seen}
    errors = {name: {n: _rms(part) for n, part in parts.items()} for name, parts in off.items()}
    return BoardResult(tuple(cameras), number, drawn, errors, moments, back_m)


def _origin(seen: Sequence[CameraDetections], origin: int | None, apart: bool) -> int:
    for s in seen:
        if not s.seen:
            raise BadInput(f"{s.name}: board seen in none of {s.looked_at} pictures; check --board and the light")
    counts: dict[int, int] = {}
    for number in (shot.number for s in seen for shot in s.seen):
        counts[number] = counts.get(number, 0) + 1
    number = max(counts, key=lambda n: (counts[n], -n)) if origin is None else origin
    needed = len(seen) if apart else 1
    if counts.get(number, 0) < needed:
        have = [str(n) for n in sorted(counts) if counts[n] >= needed][:20]
        raise BadInput(
            f"--origin {number}: {counts.get(number, 0)} of {len(seen)} cameras see the board in that picture, "
            f"{needed} must; where they do: {', '.join(have) or 'nowhere'}"
        )
    return number


def _calibrated(
    s: CameraDetections, optics: Optics, pose: RigidTransform, error_px: float, board: Board
) -> CalibratedCamera:
    told = f"{type(board).__name__.lower()} {board.columns}x{board.rows}, {board.square:g} m, {len(s.seen)} pictures"
    return CalibratedCamera(s.name, *optics, pose.R, pose.t, s.image_size_px, error_px, told)


def _rms(off: Floats) -> float:
    """(N, 2) -> root mean square of the N distances."""
    return float(np.sqrt(np.mean((off**2).sum(axis=-1))))


COLUMNS = ("x", "y", "z", "u", "v")

FEWEST_WITH_LENS = 6
"""Three fix a pose up to four solutions; six leave some to average over."""


def read_points(path: Path) -> tuple[Floats, Floats]:
    """A CSV file with columns x, y, z (metres) and u, v (pixels) -> (N, 3), (N, 2); raises BadInput naming the line."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            table = csv.DictReader(file)
            if table.fieldnames is None or not set(COLUMNS) <= {name.strip() for name in table.fieldnames}:
                raise BadInput(f"{path}: its first line must name the columns {','.join(COLUMNS)}")
            rows = [_row(path, table.line_num, row) for row in table]
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror}; a CSV file x,y,z,u,v is expected") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise BadInput(f"{path}: no CSV file: {error}") from None
    numbers = np.array(rows, dtype=np.float64).reshape(-1, 5)
    return numbers[:, :3].copy(), numbers[:, 3:].copy()


def from_points(name: str, points: Floats, pixels: Floats, source: str) -> tuple[CalibratedCamera, tuple[str, ...]]:
    """DLT (section II.A), taken apart into lens and place, no distortion; and what to know before trusting it.

    (N, 3) metres, (N, 2) pixels, N at least 6 and not in a plane. Raises BadInput as `fit_projective_matrix` does.
    """
    fitted = fit_projective_matrix(points, pixels)
    K, R, t = decomposed(fitted.matrix)
    provenance = f"DLT from {len(points)} points of {source}"
    return CalibratedCamera(name, K, np.zeros(0), R, t, None, fitted.error_px, provenance), fitted.warnings


def placed_by_points(camera: CalibratedCamera, points: Floats, pixels: Floats, source: str) -> CalibratedCamera:
    """The camera, whose lens is known, placed by (N, 3) metres and (N, 2) pixels, N at least 6; a plane will do.

    Raises BadInput for fewer, for what is not finite and for points that no place fits.
    """
    if len(points) < FEWEST_WITH_LENS or not (np.isfinite(points).all() and np.isfinite(pixels).all()):
        raise BadInput(f"{source}: {len(points)} points; {FEWEST_WITH_LENS} are needed, all finite")
    # OpenCV refuses arrays that are views of others.
    points, pixels = np.ascontiguousarray(points), np.ascontiguousarray(pixels)
    try:
        ok, turn, move = cv2.solvePnP(points, pixels, camera.K, camera.distortion, flags=cv2.SOLVEPNP_SQPNP)
        turn, move = cv2.solvePnPRefineLM(points, pixels, camera.K, camera.distortion, turn, move)
    except cv2.error:
        ok = False
    if not ok:
        raise BadInput(f"{source}: no place fits these points; check the pairs, and that they are not in one line")
    R = np.asarray(cv2.Rodrigues(turn)[0], np.float64)
    t = np.asarray(move, np.float64).ravel()
    there = CalibratedCamera(camera.name, camera.K, camera.distortion, R, t, camera.image_size_px)
    off = np.linalg.norm(there.pixels(points) - pixels, axis=1)
    if not np.isfinite(off).all():
        raise BadInput(f"{source}: {int(np.isnan(off).sum())} points would lie behind the camera; check the pairs")
    error, told = float(np.sqrt(np.mean(off**2))), f"placed by {len(points)} points of {source}; {camera.provenance}"
    return CalibratedCamera(camera.name, camera.K, camera.distortion, R, t, camera.image_size_px, error, told)


def decomposed(matrix: Floats) -> tuple[Floats, Floats, Floats]:
    """(3, 4) projective matrix, w in metres -> K (3, 3), R (3, 3), t (3,) with matrix = K [R | t]."""
    from scipy.linalg import rq

    K, R = rq(matrix[:, :3])
    signs = np.diag(np.sign(np.diag(K)))
    K, R = K @ signs, signs @ R
    t = np.linalg.solve(K, matrix[:, 3])
    return np.asarray(K / K[2, 2], np.float64), np.asarray(R, np.float64), np.asarray(t, np.float64)


def _row(path: Path, line: int, row: dict[str | None, str | None]) -> list[float]:
    named = {(key or "").strip(): value for key, value in row.items()}
    try:
        return [float(named[column] or "") for column in COLUMNS]
    except (TypeError, ValueError):
        raise BadInput(f"{path}: line {line}: five numbers x,y,z,u,v are needed; leave out what was not seen") from None
