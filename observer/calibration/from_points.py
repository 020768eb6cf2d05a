"""One camera from points whose place in the room and in its picture is known: with its lens known, or by DLT."""

import csv
from pathlib import Path

import cv2
import numpy as np

from common.errors import BadInput
from observer.calibration.calibrated import Calibrated
from observer.geometry.dlt import fit_projective_matrix
from observer.geometry.projection import Floats

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


def from_points(name: str, points: Floats, pixels: Floats, source: str) -> tuple[Calibrated, tuple[str, ...]]:
    """DLT (section II.A), taken apart into lens and place, no distortion; and what to know before trusting it.

    (N, 3) metres, (N, 2) pixels, N at least 6 and not in a plane. Raises BadInput as `fit_projective_matrix` does.
    """
    fitted = fit_projective_matrix(points, pixels)
    K, R, t = decomposed(fitted.matrix)
    provenance = f"DLT from {len(points)} points of {source}"
    return Calibrated(name, K, np.zeros(0), R, t, None, fitted.error_px, provenance), fitted.warnings


def placed_by_points(camera: Calibrated, points: Floats, pixels: Floats, source: str) -> Calibrated:
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
    there = Calibrated(camera.name, camera.K, camera.distortion, R, t, camera.image_size_px)
    off = np.linalg.norm(there.pixels(points) - pixels, axis=1)
    if not np.isfinite(off).all():
        raise BadInput(f"{source}: {int(np.isnan(off).sum())} points would lie behind the camera; check the pairs")
    error, told = float(np.sqrt(np.mean(off**2))), f"placed by {len(points)} points of {source}; {camera.provenance}"
    return Calibrated(camera.name, camera.K, camera.distortion, R, t, camera.image_size_px, error, told)


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
