"""Detection of a board's corners in pictures, and their speed from picture to picture."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.calibration.board import Board, Charuco, Chessboard
from observer.tracks import Floats, Picture, size_of

FEWEST_CORNERS = 6
"""Fewest corners that determine a pose well; a picture with fewer counts as one without a board."""

Gray = NDArray[np.uint8]
Corners = tuple[NDArray[np.intp], Floats, bool]
"""(N,) ids, (N, 2) pixels, and whether the board is seen from behind."""

Detector = Callable[[Gray], Corners | None]


@dataclass(frozen=True, slots=True, eq=False)
class BoardDetection:
    """A board in one picture. number, label: of the picture. ids: (N,) corners. pixels: (N, 2) their positions.

    behind: whether it is seen from behind, through the paper or printed on both sides.
    """

    number: int
    label: str
    ids: NDArray[np.intp]
    pixels: Floats
    behind: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class CameraDetections:
    """All detections of one camera. name: of the camera. image_size_px: (width, height). picture_count: all pictures.

    step: difference of the numbers of consecutive pictures in a video; 0 for single pictures.
    """

    name: str
    image_size_px: tuple[int, int]
    boards: tuple[BoardDetection, ...]
    picture_count: int
    step: int = 0


def find_boards(
    name: str, numbered: Iterable[tuple[int, str, Picture]], board: Board, step: int = 0
) -> CameraDetections:
    """Detect the board in each picture (number, label, picture); step: as in CameraDetections.

    Raises BadInput for no pictures and for an unknown board.
    """
    detect, size, boards, count = detector(board), None, [], 0
    for number, label, picture in numbered:
        size = size_of(picture)
        corners = detect(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY).astype(np.uint8, copy=False))
        if corners is not None and len(corners[0]) >= FEWEST_CORNERS and not _collinear(board.points[corners[0]]):
            boards.append(BoardDetection(number, label, *corners))
        count += 1
    if size is None:
        raise BadInput(f"{name}: no pictures")
    return CameraDetections(name, size, tuple(boards), count, step)


def detector(board: Board) -> Detector:
    """The function that finds this board in a gray picture: which corners, and where in px; None without one."""
    return _charuco_detector(board) if isinstance(board, Charuco) else _chessboard_detector(board)


def _chessboard_detector(board: Chessboard) -> Detector:
    size = (board.columns, board.rows)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    until = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 0.001)

    def detect(gray: Gray) -> Corners | None:
        good, corners = cv2.findChessboardCorners(gray, size, flags=flags)
        if good:
            corners = cv2.cornerSubPix(gray, corners, _window(corners, size), (-1, -1), until)
        else:
            good, corners = cv2.findChessboardCornersSB(gray, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
        if not good:
            return None
        grid = np.asarray(corners, dtype=np.float64).reshape(board.rows, board.columns, 2)
        return np.arange(board.columns * board.rows), _upright(gray, grid).reshape(-1, 2), False

    return detect


def _window(corners: NDArray[np.generic], size: tuple[int, int]) -> tuple[int, int]:
    """Half the search window of the sub-pixel refinement, which must not reach the next corner."""
    grid = np.asarray(corners, dtype=np.float64).reshape(size[1], size[0], 2)
    steps = [np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min() for axis in (0, 1)]
    half = int(np.clip(min(steps) / 3, 2, 11))
    return half, half


def _upright(gray: Gray, grid: Floats) -> Floats:
    """(rows, columns, 2) the corners in the unique order that starts at a dark inner square and is not mirrored.

    OpenCV starts at either end of the board; cameras need the same order to be placed relative to each other.
    """
    across, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if across[0] * down[1] - across[1] * down[0] < 0:
        grid = grid[:, ::-1]
    first, second = (grid[:2, n : n + 2].reshape(4, 2).mean(axis=0) for n in (0, 1))
    bright = [_brightness(gray, place) for place in (first, second)]
    return grid if bright[0] <= bright[1] else grid[::-1, ::-1]


def _brightness(gray: Gray, place: Floats) -> float:
    column, row = np.round(place).astype(int)
    return float(gray[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2].mean())


def _charuco_detector(board: Charuco) -> Detector:
    code = getattr(cv2.aruco, board.dictionary, None)
    if not (board.dictionary.startswith("DICT_") and isinstance(code, int)):
        raise BadInput(f"dictionary = {board.dictionary!r}: unknown; known: DICT_4X4_50 to DICT_7X7_1000 and the like")
    dictionary = cv2.aruco.getPredefinedDictionary(code)
    if board.columns * board.rows // 2 > len(dictionary.bytesList):
        raise BadInput(f"dictionary = {board.dictionary!r}: too few markers for {board.columns}x{board.rows} squares")
    pattern = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square, board.marker, dictionary)
    pattern.setLegacyPattern(board.legacy)
    charuco = cv2.aruco.CharucoDetector(pattern)

    def corners(gray: Gray) -> tuple[NDArray[np.intp], Floats]:
        pixels, ids, _, _ = charuco.detectBoard(gray)
        if ids is None or len(ids) == 0:
            return np.zeros(0, dtype=np.intp), np.zeros((0, 2))
        return np.asarray(ids).ravel().astype(np.intp), np.asarray(pixels, dtype=np.float64).reshape(-1, 2)

    def detect(gray: Gray) -> Corners | None:
        gray = np.subtract(255, gray, dtype=np.uint8) if board.inverted else gray
        ids, pixels = corners(gray)
        behind = len(ids) == 0
        if behind:
            # From behind, the markers are mirrored.
            ids, pixels = corners(np.ascontiguousarray(gray[:, ::-1]))
            pixels = pixels * [-1, 1] + [gray.shape[1] - 1, 0]
        return (ids, pixels, behind) if len(ids) else None

    return detect


def _collinear(points: Floats) -> bool:
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] < 1e-6 + 0.05 * spread[0])


Shot = tuple[int, NDArray[np.intp], Floats]
"""Number of the picture, (N,) ids of the corners, (N, 2) pixels."""


def speeds(shots: Sequence[Shot], step: int) -> list[Floats]:
    """For each shot (N, 2) pixels per frame, by central differences with the neighbours `step` numbers away.

    A corner that neither neighbour shows moves as the others do on average; a shot without neighbours has speed 0.
    """
    known = {number: dict(zip(ids.tolist(), pixels, strict=True)) for number, ids, pixels in shots}
    return [_speed(shot, [known.get(shot[0] + offset, {}) for offset in (-step, 0, step)]) for shot in shots]


def _speed(shot: Shot, neighbours: list[dict[int, Floats]]) -> Floats:
    _, ids, pixels = shot
    result = np.full_like(pixels, np.nan)
    for n, corner in enumerate(ids.tolist()):
        positions = [(at, corners[corner]) for at, corners in enumerate(neighbours) if corner in corners]
        (first, begin), (last, end) = positions[0], positions[-1]
        if last > first:
            result[n] = (end - begin) / (last - first)
    unknown = np.isnan(result[:, 0])
    result[unknown] = 0.0 if unknown.all() else result[~unknown].mean(axis=0)
    return result
