"""Bundle adjustment: cameras, boards and optionally lenses, refined jointly to the least reprojection error.

Two properties of a hand-held board are estimated as well: pictures of the same number are not taken at the same time
(webcams differ by a tenth of the frame interval), and a board printed on both sides has a thickness.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from observer.calibration.sparse_least_squares import (
    ParameterLayout,
    SparseJacobian,
    least_robust_squares,
)
from observer.tracks import Floats

NOISE_PX = 0.2
"""Standard deviation of a detected corner (measured on sharp and on moving boards: 0.1 to 0.3)."""
ROBUST_PX = 0.4
"""Larger errors count linearly, not squared: one wrong corner must not turn a camera."""
TIME_OFFSET = 0.1
"""Prior: standard deviation of a picture's time offset, in frame intervals (four webcams: 0.1)."""
CENTRE = 0.02
"""Prior: distance of the principal point from the middle of the picture, as a share of its longer side."""
BACK_M, BACK_RAD = 0.005, 0.05
"""Prior: position and rotation of the pattern on the board's back relative to the front: 5 mm, 3 degrees."""

Optics = tuple[Floats, Floats]
"""K (3, 3) and distortion (5,)."""


@dataclass(frozen=True, slots=True, eq=False)
class RigidTransform:
    """A rigid transform X' = R X + t; R: (3, 3), t: (3,) metres."""

    R: Floats
    t: Floats

    def after(self, first: "RigidTransform") -> "RigidTransform":
        """The composition: `first`, then this transform."""
        return RigidTransform(self.R @ first.R, self.R @ first.t + self.t)

    @property
    def inverse(self) -> "RigidTransform":
        """The inverse transform."""
        return RigidTransform(self.R.T, -self.R.T @ self.t)


@dataclass(frozen=True, slots=True, eq=False)
class BoardCorners:
    """One board in one picture: name of the camera, number of the picture, (N, 3) metres on the board, (N, 2) pixels.

    speeds: (N, 2) pixels per frame of each corner; zeros where unknown. behind: the camera sees the board's back.
    """

    camera: str
    number: int
    points: Floats
    pixels: Floats
    speeds: Floats
    behind: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class RigExtrinsics:
    """cameras: by name, room to camera. boards: by picture number, board to room. lenses: by camera, K and distortion.

    residuals_px: by camera and picture number, (N, 2) from the detected to the projected corners. time_offset: root
    mean square time offset of pictures of one number, in frames. back: (4,) the pattern on the board's back: metres
    along x, y and z, and radians about z.
    """

    cameras: dict[str, RigidTransform]
    boards: dict[int, RigidTransform]
    lenses: dict[str, Optics]
    residuals_px: dict[str, dict[int, Floats]]
    time_offset: float
    back: Floats


def bundle_adjust(
    corners: Sequence[BoardCorners],
    lenses: Mapping[str, Optics],
    cameras: Mapping[str, RigidTransform],
    boards: Mapping[int, RigidTransform],
    centres_px: Mapping[str, tuple[float, float]] | None = None,
) -> RigExtrinsics:
    """Minimise the robust reprojection error; the first camera is fixed. A single camera moves only its boards.

    centres_px: middle of the picture of each camera whose lens is refined too: one focal length, principal point, k1
    and k2. Measured on held-out pictures, more terms do not help and turn cameras instead.
    """
    problem = _Problem(corners, lenses, cameras, boards, centres_px or {})
    return problem.unpack(*least_robust_squares(problem.evaluate, problem.start, ROBUST_PX / NOISE_PX))


class _Problem:
    """The unknowns as one vector, and the residuals and Jacobian at it."""

    def __init__(
        self,
        corners: Sequence[BoardCorners],
        lenses: Mapping[str, Optics],
        cameras: Mapping[str, RigidTransform],
        boards: Mapping[int, RigidTransform],
        centres_px: Mapping[str, tuple[float, float]],
    ) -> None:
        self._corners, self._lenses = corners, lenses
        self._at = at = ParameterLayout(cameras, boards, centres_px, len(corners))
        self.start = np.zeros(at.size)
        sides = {c.behind for c in corners}
        self._two_sided = len(sides) == 2
        for name, transform in cameras.items():
            self.start[at.cameras[name]] = _vector(transform)
        for number, transform in boards.items():
            self.start[at.boards[number]] = _vector(transform)
        for name, centre in centres_px.items():
            K, distortion = lenses[name]
            self.start[at.lenses[name]] = [(K[0, 0] + K[1, 1]) / 2, *centre, distortion[0], 0.0]
        self._prior, self._width = self._expected(cameras, centres_px)

    def _expected(
        self, cameras: Mapping[str, RigidTransform], centres_px: Mapping[str, tuple[float, float]]
    ) -> tuple[Floats, Floats]:
        """Mean and standard deviation of the prior of every unknown; infinite where nothing is known."""
        at, width = self._at, np.full(self._at.size, np.inf)
        width[at.cameras[next(iter(cameras))]] = 1e-6
        for name, centre in centres_px.items():
            width[at.lenses[name]][1:3] = 2 * CENTRE * max(centre)
        width[at.time_offsets] = TIME_OFFSET
        width[at.back] = [BACK_M, BACK_M, BACK_M, BACK_RAD] if self._two_sided else 1e-9
        return self.start.copy(), width

    def optics(self, name: str, x: Floats) -> Optics:
        """The lens of this camera at `x`."""
        if name not in self._at.lenses:
            return self._lenses[name]
        f, u, v, k1, k2 = x[self._at.lenses[name]]
        return np.array([[f, 0, u], [0, f, v], [0, 0, 1]]), np.array([k1, k2, 0, 0, 0])

    def evaluate(self, x: Floats) -> tuple[Floats, SparseJacobian]:
        """All residuals in standard deviations, corners before priors, and their Jacobian."""
        blocks, off = SparseJacobian(self._at.size), []
        for n, c in enumerate(self._corners):
            off.append(self._corner_block(n, c, x, blocks) / NOISE_PX)
        known = np.flatnonzero(np.isfinite(self._width))
        blocks.add_diagonal(known, 1 / self._width[known])
        return np.concatenate([*off, (x - self._prior)[known] / self._width[known]]), blocks

    def _corner_block(self, n: int, c: BoardCorners, x: Floats, blocks: SparseJacobian) -> Floats:
        at, back, moment = self._at, x[self._at.back], x[self._at.time_offsets][n]
        rotated = np.column_stack([-c.points[:, 1], c.points[:, 0], np.zeros(len(c.points))])
        points = c.points + back[:3] + back[3] * rotated if c.behind else c.points
        poses = x[at.boards[c.number]], x[at.cameras[c.camera]]
        off, by_board, by_camera, by_point, by_lens = project_board(points, self.optics(c.camera, x), *poses)
        blocks.begin(len(off))
        blocks.add(at.boards[c.number], by_board / NOISE_PX)
        blocks.add(at.cameras[c.camera], by_camera / NOISE_PX)
        blocks.add(slice(at.time_offsets.start + n, at.time_offsets.start + n + 1), -c.speeds.reshape(-1, 1) / NOISE_PX)
        if c.behind:
            turned = np.einsum("nij,nj->ni", by_point, rotated).reshape(-1, 1)
            blocks.add(at.back, np.hstack([by_point.reshape(-1, 3), turned]) / NOISE_PX)
        if c.camera in at.lenses:
            blocks.add(at.lenses[c.camera], by_lens / NOISE_PX)
        result: Floats = off - (c.pixels + moment * c.speeds).ravel()
        return result

    def unpack(self, x: Floats, residuals: Floats) -> RigExtrinsics:
        """The vector of unknowns as cameras, boards and lenses."""
        at, ends = self._at, np.cumsum([2 * len(c.points) for c in self._corners])
        residuals_px: dict[str, dict[int, Floats]] = {name: {} for name in at.cameras}
        off_px = np.split(residuals[: ends[-1]] * NOISE_PX, ends[:-1])
        for corner, off in zip(self._corners, off_px, strict=True):
            residuals_px[corner.camera][corner.number] = off.reshape(-1, 2)
        return RigExtrinsics(
            {name: _transform(x[place]) for name, place in at.cameras.items()},
            {number: _transform(x[place]) for number, place in at.boards.items()},
            {name: self.optics(name, x) for name in at.cameras},
            residuals_px,
            float(np.sqrt(np.mean(x[at.time_offsets] ** 2))),
            x[at.back],
        )


def project_board(points: Floats, optics: Optics, board: Floats, camera: Floats) -> tuple[Floats, ...]:
    """(2N,) pixels, and their derivatives: (2N, 6) by the board's pose, (2N, 6) by the camera's, (N, 2, 3) by the
    points, (2N, 5) by the lens.
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


def _vector(transform: RigidTransform) -> Floats:
    return np.concatenate([np.asarray(cv2.Rodrigues(transform.R)[0], np.float64).ravel(), transform.t])


def _transform(vector: Floats) -> RigidTransform:
    return RigidTransform(np.asarray(cv2.Rodrigues(vector[:3])[0], np.float64), vector[3:])
