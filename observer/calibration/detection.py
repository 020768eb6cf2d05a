"""Finding a board's corners in pictures, and how fast they move from picture to picture."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.calibration.board import Board, Charuco, Chessboard
from observer.calibration.pictures import Picture
from observer.geometry.projection import Floats

FEWEST = 6
"""Fewer corners of a board than this say little about its pose: the picture counts as without board."""

Gray = NDArray[np.uint8]
Found = tuple[NDArray[np.intp], Floats, bool]
"""(N,) ids, (N, 2) pixels, and whether the board is seen from behind."""

Find = Callable[[Gray], Found | None]


@dataclass(frozen=True, slots=True, eq=False)
class BoardDetection:
    """A board seen in one picture. number, label: which picture. ids: (N,) corners. pixels: (N, 2) where they are.

    behind: whether it is seen from behind, through the paper or printed on both sides.
    """

    number: int
    label: str
    ids: NDArray[np.intp]
    pixels: Floats
    behind: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class CameraDetections:
    """What one camera saw. name: of the camera. image_size_px: (width, height). looked_at: number of pictures.

    step: by how much the numbers of pictures grow that are neighbours in a video; 0 for pictures taken one by one.
    """

    name: str
    image_size_px: tuple[int, int]
    seen: tuple[BoardDetection, ...]
    looked_at: int
    step: int = 0


def find_boards(name: str, taken: Iterable[tuple[int, str, Picture]], board: Board, step: int = 0) -> CameraDetections:
    """The board in each picture; step: as in Sightings.

    Raises BadInput for pictures of different sizes, none at all, or an unknown board.
    """
    find, size, seen, count = finder(board), None, [], 0
    for number, label, picture in taken:
        height, width = picture.shape[:2]
        size = size or (width, height)
        if size != (width, height):
            raise BadInput(f"{name}: {label} is {width}x{height}, the first picture {size[0]}x{size[1]}; one size only")
        found = find(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY).astype(np.uint8, copy=False))
        if found is not None and len(found[0]) >= FEWEST and not _in_line(board.points[found[0]]):
            seen.append(BoardDetection(number, label, *found))
        count += 1
    if size is None:
        raise BadInput(f"{name}: no pictures")
    return CameraDetections(name, size, tuple(seen), count, step)


def finder(board: Board) -> Find:
    """The function that finds this board's corners in a gray picture, or None."""
    return _charuco_finder(board) if isinstance(board, Charuco) else _chessboard_finder(board)


def _chessboard_finder(board: Chessboard) -> Find:
    size = (board.columns, board.rows)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    until = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 0.001)

    def find(gray: Gray) -> Found | None:
        found, corners = cv2.findChessboardCorners(gray, size, flags=flags)
        if found:
            corners = cv2.cornerSubPix(gray, corners, _window(corners, size), (-1, -1), until)
        else:
            found, corners = cv2.findChessboardCornersSB(gray, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
        if not found:
            return None
        grid = np.asarray(corners, dtype=np.float64).reshape(board.rows, board.columns, 2)
        return np.arange(board.columns * board.rows), _upright(gray, grid).reshape(-1, 2), False

    return find


def _window(corners: NDArray[np.generic], size: tuple[int, int]) -> tuple[int, int]:
    """Half the search window of the refinement: it must not reach the next corner."""
    grid = np.asarray(corners, dtype=np.float64).reshape(size[1], size[0], 2)
    steps = [np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min() for axis in (0, 1)]
    half = int(np.clip(min(steps) / 3, 2, 11))
    return half, half


def _upright(gray: Gray, grid: Floats) -> Floats:
    """(rows, columns, 2) the corners in the one order in which the first square inside them is dark, not mirrored.

    OpenCV starts at either end of the board, and cameras that disagree on it cannot be placed from it.
    """
    across, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if across[0] * down[1] - across[1] * down[0] < 0:
        grid = grid[:, ::-1]
    first, beside = (grid[:2, n : n + 2].reshape(4, 2).mean(axis=0) for n in (0, 1))
    bright = [_brightness(gray, place) for place in (first, beside)]
    result: Floats = grid if bright[0] <= bright[1] else grid[::-1, ::-1]
    return result


def _brightness(gray: Gray, place: Floats) -> float:
    column, row = np.round(place).astype(int)
    return float(gray[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2].mean())


def _charuco_finder(board: Charuco) -> Find:
    code = getattr(cv2.aruco, board.dictionary, None)
    if not (board.dictionary.startswith("DICT_") and isinstance(code, int)):
        raise BadInput(f"dictionary = {board.dictionary!r}: unknown; known: DICT_4X4_50 to DICT_7X7_1000 and the like")
    dictionary = cv2.aruco.getPredefinedDictionary(code)
    if board.columns * board.rows // 2 > len(dictionary.bytesList):
        raise BadInput(f"dictionary = {board.dictionary!r}: too few markers for {board.columns}x{board.rows} squares")
    drawn = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square, board.marker, dictionary)
    drawn.setLegacyPattern(board.legacy)
    detector = cv2.aruco.CharucoDetector(drawn)

    def look(gray: Gray) -> tuple[NDArray[np.intp], Floats]:
        pixels, ids, _, _ = detector.detectBoard(gray)
        if ids is None or len(ids) == 0:
            return np.zeros(0, dtype=np.intp), np.zeros((0, 2))
        return np.asarray(ids).ravel().astype(np.intp), np.asarray(pixels, dtype=np.float64).reshape(-1, 2)

    def find(gray: Gray) -> Found | None:
        gray = np.subtract(255, gray, dtype=np.uint8) if board.inverted else gray
        ids, pixels = look(gray)
        behind = len(ids) == 0
        if behind:
            # From behind, through the paper or printed on both sides, the markers are mirrored.
            ids, pixels = look(np.ascontiguousarray(gray[:, ::-1]))
            pixels = pixels * [-1, 1] + [gray.shape[1] - 1, 0]
        return (ids, pixels, behind) if len(ids) else None

    return find


def _in_line(points: Floats) -> bool:
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] < 1e-6 + 0.05 * spread[0])


Shot = tuple[int, NDArray[np.intp], Floats]
"""Number of the picture, (N,) ids of the corners, (N, 2) pixels."""


def speeds(shots: Sequence[Shot], step: int) -> list[Floats]:
    """For each shot (N, 2) pixels from picture to picture, `step` numbers apart, by its neighbours.

    A corner that neither neighbour has moves as the others do on average; a shot without neighbours does not move.
    """
    known = {number: dict(zip(ids.tolist(), pixels, strict=True)) for number, ids, pixels in shots}
    return [_of(shot, [known.get(shot[0] + away, {}) for away in (-step, 0, step)]) for shot in shots]


def _of(shot: Shot, neighbours: list[dict[int, Floats]]) -> Floats:
    _, ids, pixels = shot
    result = np.full_like(pixels, np.nan)
    for n, corner in enumerate(ids.tolist()):
        places = [(at, found[corner]) for at, found in enumerate(neighbours) if corner in found]
        (first, begin), (last, end) = places[0], places[-1]
        if last > first:
            result[n] = (end - begin) / (last - first)
    unknown = np.isnan(result[:, 0])
    result[unknown] = 0.0 if unknown.all() else result[~unknown].mean(axis=0)
    return result
