"""Bundle adjustment: cameras, boards and, where asked, lenses moved together until all corners lie best.

Two things that a board in somebody's hands brings with it are found beside: pictures of one number are not of one
moment (webcams differ by a tenth of the time between pictures), and a board printed on both sides has a thickness.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from observer.calibration.sparse_least_squares import (
    LeastSquaresResult,
    ParameterLayout,
    SparseJacobian,
    least_robust_squares,
)
from observer.geometry.projection import Floats

NOISE_PX = 0.2
"""How far a corner is found beside where it is (measured on sharp and on moving boards: 0.1 to 0.3)."""

ROBUST_PX = 0.4
"""Beyond this a corner's error counts by its size, not its square: one wrong corner must not turn a camera."""

MOMENTS = 0.1
"""Prior: by how much of the time between two pictures those of one number are apart (four webcams: 0.1)."""

CENTRE = 0.02
"""Prior: how far a lens's centre is from the picture's, as a share of its longer side."""

BACK_M, BACK_RAD = 0.005, 0.05
"""Prior: how the pattern on a board's back lies to the one in front: half a centimetre off or behind, 3 degrees."""

Place = tuple[Floats, Floats]
"""(3, 3) rotation and (3,) translation."""

Optics = tuple[Floats, Floats]
"""K (3, 3) and distortion (5,)."""


@dataclass(frozen=True, slots=True, eq=False)
class BoardCorners:
    """One board in one picture: camera's name, picture's number, (N, 3) metres on the board, (N, 2) pixels.

    speeds: (N, 2) pixels by which each corner moves from picture to picture; zeros where that is not known.
    behind: whether the camera sees the board's back.
    """

    camera: str
    number: int
    points: Floats
    pixels: Floats
    speeds: Floats
    behind: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class BundleResult:
    """cameras: from the room, boards: to the room, lenses: by camera, those given where they were not to be moved.

    moments: of each of the Corners, pictures by which it is later than its number says. back: (4,) where the pattern on
    the board's back lies: metres along x, y, z, and radians about z. pixels_off: of each of the Corners, (N, 2).
    """

    cameras: dict[str, Place]
    boards: dict[int, Place]
    lenses: dict[str, Optics]
    moments: Floats
    back: Floats
    pixels_off: tuple[Floats, ...]


def bundle_adjust(
    corners: Sequence[BoardCorners],
    lenses: Mapping[str, Optics],
    cameras: Mapping[str, Place],
    boards: Mapping[int, Place],
    centres_px: Mapping[str, tuple[float, float]] | None = None,
) -> BundleResult:
    """Least robust reprojection error; the first camera stays where it is.

    centres_px: middle of the picture of each camera whose lens is adjusted too: one focal length, centre, k1 and k2,
    no more (more terms explain pictures that were left out no better, measured, and turn cameras instead). One camera
    alone changes nothing but its boards.
    """
    problem = _Problem(corners, lenses, cameras, boards, centres_px or {})
    found = least_robust_squares(problem.evaluate, problem.start, ROBUST_PX / NOISE_PX)
    return problem.told(found)


class _Problem:
    """The unknowns as one vector, and what it says of every corner."""

    def __init__(
        self,
        corners: Sequence[BoardCorners],
        lenses: Mapping[str, Optics],
        cameras: Mapping[str, Place],
        boards: Mapping[int, Place],
        centres_px: Mapping[str, tuple[float, float]],
    ) -> None:
        self._corners, self._lenses = corners, lenses
        self._at = at = ParameterLayout(tuple(cameras), tuple(boards), tuple(centres_px), len(corners))
        self.start = np.zeros(at.size)
        sides = {c.behind for c in corners}
        self._two_sided = len(sides) == 2
        for name, place in cameras.items():
            self.start[at.camera(name)] = _vector(place)
        for number, place in boards.items():
            self.start[at.board(number)] = _vector(place)
        for name, centre in centres_px.items():
            K, distortion = lenses[name]
            self.start[at.lens(name)] = [(K[0, 0] + K[1, 1]) / 2, *centre, distortion[0], 0.0]
        self._prior, self._width = self._expected(cameras, centres_px)

    def _expected(
        self, cameras: Mapping[str, Place], centres_px: Mapping[str, tuple[float, float]]
    ) -> tuple[Floats, Floats]:
        """Of every unknown what it should be and how surely (standard deviation, infinite where nothing is known)."""
        at, width = self._at, np.full(self._at.size, np.inf)
        width[at.camera(next(iter(cameras)))] = 1e-6
        for name, centre in centres_px.items():
            width[at.lens(name)][1:3] = 2 * CENTRE * max(centre)
        width[at.moments] = MOMENTS
        width[at.back] = [BACK_M, BACK_M, BACK_M, BACK_RAD] if self._two_sided else 1e-9
        return self.start.copy(), width

    def optics(self, name: str, x: Floats) -> Optics:
        """The lens of this camera as `x` has it."""
        if name not in self._at.lenses:
            return self._lenses[name]
        f, u, v, k1, k2 = x[self._at.lens(name)]
        return np.array([[f, 0, u], [0, f, v], [0, 0, 1]]), np.array([k1, k2, 0, 0, 0])

    def evaluate(self, x: Floats) -> tuple[Floats, SparseJacobian]:
        """All residuals in standard deviations, corners first and priors after, and their slopes."""
        blocks, off = SparseJacobian(self._at.size), []
        for n, c in enumerate(self._corners):
            off.append(self._corner_block(n, c, x, blocks) / NOISE_PX)
        known = np.flatnonzero(np.isfinite(self._width))
        blocks.add_diagonal(known, 1 / self._width[known])
        return np.concatenate([*off, (x - self._prior)[known] / self._width[known]]), blocks

    def _corner_block(self, n: int, c: BoardCorners, x: Floats, blocks: SparseJacobian) -> Floats:
        at, back, moment = self._at, x[self._at.back], x[self._at.moments][n]
        beside = np.column_stack([-c.points[:, 1], c.points[:, 0], np.zeros(len(c.points))])
        points = c.points + back[:3] + back[3] * beside if c.behind else c.points
        poses = x[at.board(c.number)], x[at.camera(c.camera)]
        off, by_board, by_camera, by_point, by_lens = project_board(points, self.optics(c.camera, x), *poses)
        blocks.begin(len(off))
        blocks.add(at.board(c.number), by_board / NOISE_PX)
        blocks.add(at.camera(c.camera), by_camera / NOISE_PX)
        blocks.add(slice(at.moments.start + n, at.moments.start + n + 1), -c.speeds.reshape(-1, 1) / NOISE_PX)
        if c.behind:
            turned = np.einsum("nij,nj->ni", by_point, beside).reshape(-1, 1)
            blocks.add(at.back, np.hstack([by_point.reshape(-1, 3), turned]) / NOISE_PX)
        if c.camera in at.lenses:
            blocks.add(at.lens(c.camera), by_lens / NOISE_PX)
        result: Floats = off - (c.pixels + moment * c.speeds).ravel()
        return result

    def told(self, found: LeastSquaresResult) -> BundleResult:
        """The vector as cameras, boards and lenses."""
        x, at, ends = found.x, self._at, np.cumsum([2 * len(c.points) for c in self._corners])
        off = np.split(found.residuals[: ends[-1]] * NOISE_PX, ends[:-1])
        return BundleResult(
            {name: _place(x[at.camera(name)]) for name in at.cameras},
            {number: _place(x[at.board(number)]) for number in at.boards},
            {name: self.optics(name, x) for name in at.cameras},
            x[at.moments],
            x[at.back],
            tuple(part.reshape(-1, 2) for part in off),
        )


def project_board(points: Floats, optics: Optics, board: Floats, camera: Floats) -> tuple[Floats, ...]:
    """(2N,) pixels, and their slopes: (2N, 6) by the board's pose, (2N, 6) by the camera's, (N, 2, 3) by the points,
    (2N, 5) by the lens.
    """
    joint = [np.asarray(part, np.float64) for part in cv2.composeRT(board[:3], board[3:], camera[:3], camera[3:])]
    turn, move, r_rb, r_tb, r_rc, r_tc, t_rb, t_tb, t_rc, t_tc = joint
    image, jacobian = cv2.projectPoints(np.ascontiguousarray(points), turn, move, *optics)
    slopes = np.asarray(jacobian, np.float64)
    by_turn, by_move = slopes[:, :3], slopes[:, 3:6]
    by_board = by_turn @ np.hstack([r_rb, r_tb]) + by_move @ np.hstack([t_rb, t_tb])
    by_camera = by_turn @ np.hstack([r_rc, r_tc]) + by_move @ np.hstack([t_rc, t_tc])
    by_point = by_move.reshape(-1, 2, 3) @ np.asarray(cv2.Rodrigues(turn)[0], np.float64)
    by_lens = np.column_stack([slopes[:, 6] + slopes[:, 7], slopes[:, 8:12]])
    return np.asarray(image, np.float64).ravel(), by_board, by_camera, by_point, by_lens


def _vector(place: Place) -> Floats:
    return np.concatenate([np.asarray(cv2.Rodrigues(place[0])[0], np.float64).ravel(), place[1]])


def _place(vector: Floats) -> Place:
    return np.asarray(cv2.Rodrigues(vector[:3])[0], np.float64), vector[3:]
