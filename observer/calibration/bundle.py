"""Bundle adjustment: all cameras and all boards moved together until the corners lie best in all pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from observer.geometry.projection import Floats

ROBUST_PX = 1.0
"""Beyond this a corner's error counts by its size, not its square: one wrong corner must not turn a camera."""

ROUNDS = 50
"""Evaluations at most; ten are usual."""

Place = tuple[Floats, Floats]
"""(3, 3) rotation and (3,) translation."""


@dataclass(frozen=True, slots=True, eq=False)
class Corners:
    """One board in one picture: camera's name, picture's number, (N, 3) metres on the board, (N, 2) pixels."""

    camera: str
    number: int
    points: Floats
    pixels: Floats


def adjusted(
    corners: Sequence[Corners],
    lenses: Mapping[str, Place],
    cameras: Mapping[str, Place],
    boards: Mapping[int, Place],
) -> tuple[dict[str, Place], dict[int, Place]]:
    """Cameras (from the room) and boards (to the room) of least robust reprojection error; the first camera stays.

    lenses: K (3, 3) and distortion by camera. One camera alone changes nothing but its boards.
    """
    from scipy.optimize import least_squares

    names, numbers = list(cameras), list(boards)
    column = {name: 6 * n for n, name in enumerate(names)}
    column_of_board = {number: 6 * (len(names) + n) for n, number in enumerate(numbers)}
    start = np.concatenate([_vector(cameras[n]) for n in names] + [_vector(boards[n]) for n in numbers])
    free = slice(6, None)

    def whole(vector: Floats) -> Floats:
        return np.concatenate([start[:6], vector])

    def parts(vector: Floats) -> list[tuple[Floats, Floats, Floats]]:
        x = whole(vector)
        at = [(column_of_board[c.number], column[c.camera]) for c in corners]
        return [_seen(c, lenses[c.camera], x[b : b + 6], x[k : k + 6]) for c, (b, k) in zip(corners, at, strict=True)]

    def residuals(vector: Floats) -> Floats:
        return np.concatenate([part[0] for part in parts(vector)])

    def slopes(vector: Floats) -> Floats:
        rows = []
        for c, (_, by_board, by_camera) in zip(corners, parts(vector), strict=True):
            row = np.zeros((len(by_board), len(start)))
            row[:, column_of_board[c.number] :][:, :6] = by_board
            row[:, column[c.camera] :][:, :6] = by_camera
            rows.append(row[:, free])
        return np.concatenate(rows)

    found = least_squares(
        residuals, start[free], slopes, method="trf", tr_solver="lsmr", loss="soft_l1", f_scale=ROBUST_PX,
        max_nfev=ROUNDS, x_scale="jac",
    )  # fmt: skip
    x = whole(found.x)
    moved = {name: _place(x[column[name] :][:6]) for name in names}
    return moved, {number: _place(x[column_of_board[number] :][:6]) for number in numbers}


def _seen(corners: Corners, lens: Place, board: Floats, camera: Floats) -> tuple[Floats, Floats, Floats]:
    """(2N,) pixels off, (2N, 6) its slopes by the board's pose and (2N, 6) by the camera's."""
    joint = [np.asarray(part, np.float64) for part in cv2.composeRT(board[:3], board[3:], camera[:3], camera[3:])]
    turn, move, r_rb, r_tb, r_rc, r_tc, t_rb, t_tb, t_rc, t_tc = joint
    image, jacobian = cv2.projectPoints(corners.points, turn, move, *lens)
    by_turn, by_move = np.asarray(jacobian, np.float64)[:, :3], np.asarray(jacobian, np.float64)[:, 3:6]
    by_board = by_turn @ np.hstack([r_rb, r_tb]) + by_move @ np.hstack([t_rb, t_tb])
    by_camera = by_turn @ np.hstack([r_rc, r_tc]) + by_move @ np.hstack([t_rc, t_tc])
    off: Floats = (np.asarray(image, np.float64).reshape(-1, 2) - corners.pixels).ravel()
    return off, by_board, by_camera


def _vector(place: Place) -> Floats:
    return np.concatenate([np.asarray(cv2.Rodrigues(place[0])[0], np.float64).ravel(), place[1]])


def _place(vector: Floats) -> Place:
    return np.asarray(cv2.Rodrigues(vector[:3])[0], np.float64), vector[3:]
