"""Extrinsics: where cameras stand relative to each other, from a board that several of them see at the same time."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import cv2
import numpy as np

from common.errors import BadInput
from observer.calibration.board import Board
from observer.calibration.bundle import BoardCorners, BundleResult, Optics, bundle_adjust
from observer.calibration.calibrated import angle_between
from observer.calibration.detection import BoardDetection, CameraDetections, speeds
from observer.calibration.intrinsics import FittedLens, check_sensible
from observer.geometry.projection import Floats

DISAGREE_RAD, DISAGREE = 0.35, 0.5
"""Relative poses of two cameras that lie apart by more, 20 degrees or half their distance, are not of one moment."""

SQUARE = 0.05
"""A lens whose focal lengths differ by a larger share has no square pixels, and is not adjusted as if it had."""


@dataclass(frozen=True, slots=True, eq=False)
class RigidTransform:
    """R: (3, 3), t: (3,) metres: X' = R X + t."""

    R: Floats
    t: Floats

    def after(self, first: "RigidTransform") -> "RigidTransform":
        """What `first` and then this one do."""
        return RigidTransform(self.R @ first.R, self.R @ first.t + self.t)

    @property
    def back(self) -> "RigidTransform":
        """The way back."""
        return RigidTransform(self.R.T, -self.R.T @ self.t)


@dataclass(frozen=True, slots=True, eq=False)
class RigExtrinsics:
    """cameras: by name, from the room to the camera. boards: by picture number, from the board to the room.

    lenses: by camera, K and distortion. off_px: by camera, by picture number, (N, 2) from the corners found to where
    they should be. moments: root mean square of how far pictures of one number are apart, in pictures. back: (4,) the
    pattern on the board's back: metres along x, y and z, and radians about z.
    """

    cameras: dict[str, RigidTransform]
    boards: dict[int, RigidTransform]
    lenses: dict[str, Optics]
    off_px: dict[str, dict[int, Floats]]
    moments: float
    back: Floats


def board_pose(sighting: BoardDetection, board: Board, lens: FittedLens) -> RigidTransform:
    """From the board to the camera that saw it, by the better of a plane's two solutions (IPPE), refined."""
    space, image = board.points[sighting.ids], sighting.pixels
    _, turns, moves, _ = cv2.solvePnPGeneric(space, image, lens.K, lens.distortion, flags=cv2.SOLVEPNP_IPPE)
    turn, move = cv2.solvePnPRefineLM(space, image, lens.K, lens.distortion, turns[0], moves[0])
    return RigidTransform(np.asarray(cv2.Rodrigues(turn)[0], np.float64), np.asarray(move, np.float64).ravel())


def solve_extrinsics(
    cameras: Sequence[CameraDetections], lenses: Mapping[str, FittedLens], board: Board, adjust: Collection[str] = ()
) -> RigExtrinsics:
    """All cameras in the frame of the first one; pictures of the same number are taken as taken at the same time.

    Pairs are placed by the relative pose that most of their shared pictures agree with, the pairs with most shared
    pictures joined into a tree, then all cameras and boards moved together for the least reprojection error, and with
    them the lenses of those named in `adjust`, when there are several cameras.
    Raises BadInput for a camera that shares no picture with the others, for pictures not taken at the same time, and
    for a lens that becomes none.
    """
    if len(cameras) > 1 and board.turned_looks_alike:
        raise BadInput("--board: looks the same upside down, which way cameras see it is not known; one of columns and "
                       "rows must be even, the other odd, or use ChArUco")  # fmt: skip
    seen = {c.name: {s.number: board_pose(s, board, lenses[c.name]) for s in c.seen} for c in cameras}
    poses = _joined(seen)
    boards: dict[int, RigidTransform] = {}
    for name, shots in seen.items():
        for number, pose in shots.items():
            boards.setdefault(number, poses[name].back.after(pose))
    corners = [corner for c in cameras for corner in _corners(c, board)]
    moved = bundle_adjust(
        corners,
        {name: (lens.K, lens.distortion) for name, lens in lenses.items()},
        {name: (p.R, p.t) for name, p in poses.items()},
        {number: (p.R, p.t) for number, p in boards.items()},
        {c.name: _middle(c) for c in cameras if len(cameras) > 1 and c.name in adjust and _square(lenses[c.name])},
    )
    for c in cameras:
        check_sensible(c, moved.lenses[c.name][0])
    return _told(corners, moved)


def _told(corners: Sequence[BoardCorners], moved: BundleResult) -> RigExtrinsics:
    off: dict[str, dict[int, Floats]] = {name: {} for name in moved.cameras}
    for corner, pixels in zip(corners, moved.pixels_off, strict=True):
        off[corner.camera][corner.number] = pixels
    return RigExtrinsics(
        {n: RigidTransform(*p) for n, p in moved.cameras.items()},
        {n: RigidTransform(*p) for n, p in moved.boards.items()},
        moved.lenses,
        off,
        float(np.sqrt(np.mean(moved.moments**2))),
        moved.back,
    )


def _corners(camera: CameraDetections, board: Board) -> list[BoardCorners]:
    if camera.step:
        moving = speeds([(s.number, s.ids, s.pixels) for s in camera.seen], camera.step)
    else:
        moving = [np.zeros_like(s.pixels) for s in camera.seen]
    return [
        BoardCorners(camera.name, s.number, board.points[s.ids], s.pixels, speed, s.behind)
        for s, speed in zip(camera.seen, moving, strict=True)
    ]


def _square(lens: FittedLens) -> bool:
    return bool(abs(lens.K[0, 0] / lens.K[1, 1] - 1) < SQUARE)


def _middle(camera: CameraDetections) -> tuple[float, float]:
    """(u, v) of the middle of the picture; the first pixel's centre is at 0."""
    width, height = camera.image_size_px
    return (width - 1) / 2, (height - 1) / 2


def _joined(seen: dict[str, dict[int, RigidTransform]]) -> dict[str, RigidTransform]:
    """From the first camera's frame to each camera, along the pairs with most shared pictures (Prim's tree)."""
    names = list(seen)
    shared = {pair: len(seen[pair[0]].keys() & seen[pair[1]].keys()) for pair in permutations(names, 2)}
    poses = {names[0]: RigidTransform(np.eye(3), np.zeros(3))}
    while len(poses) < len(names):
        count, known, new = max((shared[k, n], k, n) for k in poses for n in names if n not in poses)
        if count == 0:
            lost = ", ".join(n for n in names if n not in poses)
            raise BadInput(
                f"{lost}: no picture shows the board at the same time to it and to {', '.join(poses)}; hold it where "
                "two cameras see it, or give --apart when the pictures were not taken at the same time"
            )
        poses[new] = _between(seen[known], seen[new], f"{known} and {new}").after(poses[known])
    return poses


def _between(known: dict[int, RigidTransform], new: dict[int, RigidTransform], names: str) -> RigidTransform:
    """From one camera to another: that of the shared pictures' relative poses which the others lie nearest to."""
    found = [new[n].after(known[n].back) for n in sorted(known.keys() & new.keys())]
    gaps = np.zeros((len(found), len(found)))
    for (i, first), (j, second) in combinations(enumerate(found), 2):
        apart = float(np.linalg.norm(first.t - second.t))
        far = apart / max(1e-9, float(np.linalg.norm(first.t)), float(np.linalg.norm(second.t)))
        gaps[i, j] = gaps[j, i] = max(angle_between(first.R, second.R) / DISAGREE_RAD, far / DISAGREE)
    middle = np.median(gaps, axis=1)
    if middle.min() > 1:
        raise BadInput(
            f"{names}: their {len(found)} shared pictures contradict each other; pictures of one number must be taken "
            "at the same time, else give --apart"
        )
    return found[int(middle.argmin())]
