"""Camera parameters from boards: the lens of each camera (Zhang 2000), then the poses of cameras that see one board."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import cv2
import numpy as np

from common.errors import BadInput
from common.text import plural
from observer.calibration.board import Board
from observer.calibration.bundle import BoardCorners, RigExtrinsics, RigidTransform, bundle_adjust
from observer.calibration.calibrated import angle_between
from observer.calibration.detection import BoardDetection, CameraDetections, speeds
from observer.tracks import Floats

FEWEST_PICTURES = 4
"""Each picture of a plane gives two equations for four unknowns and the distortion."""
MOST_PICTURES = 40
"""More hardly improve the result (Zhang 2000: 10 are good, 20 very good), and the time grows with their square."""
OUTLIER_PX, OUTLIER_TIMES = 1.0, 3.0
"""A picture with an error above both 1 px and three times the median is an outlier (blur, a hand) and is left out."""


@dataclass(frozen=True, slots=True, eq=False)
class FittedLens:
    """K: (3, 3), distortion: (5,) k1 k2 p1 p2 k3. error_px: root mean square reprojection error of the pictures used.

    errors_px: root mean square by picture number. left_out: numbers of the outliers.
    """

    K: Floats
    distortion: Floats
    error_px: float
    errors_px: dict[int, float]
    left_out: tuple[int, ...] = ()


def fit_lens(camera: CameraDetections, board: Board) -> FittedLens:
    """The lens with the least squared reprojection error (by OpenCV), with k3 fixed at 0.

    Raises BadInput when the board is detected in fewer than four pictures or always from the same direction.
    """
    count = len(camera.boards)
    # Evenly over time.
    chosen = [camera.boards[n] for n in np.unique(np.linspace(0, count - 1, min(MOST_PICTURES, count)).astype(int))]
    if len(chosen) < FEWEST_PICTURES:
        raise BadInput(
            f"{camera.name}: board detected in {len(chosen)} of {plural(camera.picture_count, 'picture')}; the lens "
            f"needs {FEWEST_PICTURES}, better 15, tilted in several directions: check --board, or give --lens FILE"
        )
    lens = _fitted(camera, chosen, board)
    limit = max(OUTLIER_PX, OUTLIER_TIMES * float(np.median(list(lens.errors_px.values()))))
    good = [s for s in chosen if lens.errors_px[s.number] <= limit]
    if FEWEST_PICTURES <= len(good) < len(chosen):
        left_out = tuple(s.number for s in chosen if s not in good)
        again = _fitted(camera, good, board)
        lens = FittedLens(again.K, again.distortion, again.error_px, again.errors_px, left_out)
    check_plausible(camera, lens.K)
    return lens


def check_plausible(camera: CameraDetections, K: Floats) -> None:
    """Raise BadInput for an implausible focal length or principal point."""
    width, height = camera.image_size_px
    if not (0.2 < K[0, 0] / max(width, height) < 20 and 0 < K[0, 2] < width and 0 < K[1, 2] < height):
        raise BadInput(
            f"{camera.name}: no plausible lens fits (focal length {K[0, 0]:.0f} px); "
            "take pictures with the board tilted in several directions, over the whole picture"
        )


def _fitted(camera: CameraDetections, chosen: list[BoardDetection], board: Board) -> FittedLens:
    space = [board.points[s.ids].astype(np.float32) for s in chosen]
    image = [s.pixels.astype(np.float32) for s in chosen]
    start = np.eye(3)
    try:
        error, K, distortion, _, _, _, _, each = cv2.calibrateCameraExtended(
            space, image, camera.image_size_px, start, np.zeros(5), flags=cv2.CALIB_FIX_K3
        )
    except cv2.error:
        raise BadInput(
            f"{camera.name}: no lens fits; take pictures with the board tilted in several directions"
        ) from None
    errors = {s.number: float(e) for s, e in zip(chosen, each.ravel(), strict=True)}
    return FittedLens(np.asarray(K, np.float64), np.asarray(distortion, np.float64).ravel(), float(error), errors)


DISAGREE_RAD, DISAGREE = 0.35, 0.5
"""Relative poses of two cameras that differ by 20 degrees or half their distance come from different moments."""
SQUARE_PIXELS = 0.05
"""A lens whose focal lengths differ by a larger share has no square pixels, and it is not refined."""


def board_pose(detection: BoardDetection, board: Board, lens: FittedLens) -> RigidTransform:
    """Board to camera, by the better of the two solutions for a plane (IPPE, Collins and Bartoli 2014), refined."""
    space, image = board.points[detection.ids], detection.pixels
    _, turns, moves, _ = cv2.solvePnPGeneric(space, image, lens.K, lens.distortion, flags=cv2.SOLVEPNP_IPPE)
    turn, move = cv2.solvePnPRefineLM(space, image, lens.K, lens.distortion, turns[0], moves[0])
    return RigidTransform(np.asarray(cv2.Rodrigues(turn)[0], np.float64), np.asarray(move, np.float64).ravel())


def solve_extrinsics(
    cameras: Sequence[CameraDetections], lenses: Mapping[str, FittedLens], board: Board, adjust: Collection[str] = ()
) -> RigExtrinsics:
    """All cameras in the frame of the first one; pictures of the same number count as taken at the same time.

    Pairs get the relative pose that most of their shared pictures agree with; the pairs with most shared pictures form
    a tree; then bundle adjustment refines all cameras and boards, and with several cameras the lenses of those named in
    `adjust`. Raises BadInput for a camera that shares no picture with the others, for pictures not taken at the same
    time, and for a lens that becomes implausible.
    """
    if len(cameras) > 1 and board.turned_looks_alike:
        raise BadInput("--board: looks the same upside down, which is ambiguous for several cameras; use a board with "
                       "one odd and one even number of corners, or ChArUco")  # fmt: skip
    board_poses = {c.name: {s.number: board_pose(s, board, lenses[c.name]) for s in c.boards} for c in cameras}
    poses = _spanning_tree(board_poses)
    boards: dict[int, RigidTransform] = {}
    for name, shots in board_poses.items():
        for number, pose in shots.items():
            boards.setdefault(number, poses[name].inverse.after(pose))
    corners = [corner for c in cameras for corner in _corners(c, board)]
    refinable = [c for c in cameras if len(cameras) > 1 and c.name in adjust and _has_square_pixels(lenses[c.name])]
    # The centre of the first pixel is at 0.
    centres_px = {c.name: ((c.image_size_px[0] - 1) / 2, (c.image_size_px[1] - 1) / 2) for c in refinable}
    optics = {name: (lens.K, lens.distortion) for name, lens in lenses.items()}
    refined = bundle_adjust(corners, optics, poses, boards, centres_px)
    for c in cameras:
        check_plausible(c, refined.lenses[c.name][0])
    return refined


def _corners(camera: CameraDetections, board: Board) -> list[BoardCorners]:
    if camera.step:
        corner_speeds = speeds([(s.number, s.ids, s.pixels) for s in camera.boards], camera.step)
    else:
        corner_speeds = [np.zeros_like(s.pixels) for s in camera.boards]
    return [
        BoardCorners(camera.name, s.number, board.points[s.ids], s.pixels, speed, s.behind)
        for s, speed in zip(camera.boards, corner_speeds, strict=True)
    ]


def _has_square_pixels(lens: FittedLens) -> bool:
    return bool(abs(lens.K[0, 0] / lens.K[1, 1] - 1) < SQUARE_PIXELS)


def _spanning_tree(board_poses: dict[str, dict[int, RigidTransform]]) -> dict[str, RigidTransform]:
    """From the first camera's frame to each camera, along the pairs with most shared pictures (Prim's tree)."""
    names = list(board_poses)
    numbers = {name: poses.keys() for name, poses in board_poses.items()}
    shared = {(one, other): len(numbers[one] & numbers[other]) for one, other in permutations(names, 2)}
    poses = {names[0]: RigidTransform(np.eye(3), np.zeros(3))}
    while len(poses) < len(names):
        count, known, new = max((shared[k, n], k, n) for k in poses for n in names if n not in poses)
        if count == 0:
            lost = ", ".join(n for n in names if n not in poses)
            raise BadInput(
                f"{lost}: shares no picture of the board with {', '.join(poses)}; hold it where two cameras see it, or "
                "give --apart when the pictures were not taken at the same time"
            )
        poses[new] = _relative_pose(board_poses[known], board_poses[new], f"{known} and {new}").after(poses[known])
    return poses


def _relative_pose(known: dict[int, RigidTransform], new: dict[int, RigidTransform], names: str) -> RigidTransform:
    """From one camera to another: the medoid of the relative poses of the shared pictures."""
    candidates = [new[n].after(known[n].inverse) for n in sorted(known.keys() & new.keys())]
    gaps = np.zeros((len(candidates), len(candidates)))
    for (i, first), (j, second) in combinations(enumerate(candidates), 2):
        distance = float(np.linalg.norm(first.t - second.t))
        relative = distance / max(1e-9, float(np.linalg.norm(first.t)), float(np.linalg.norm(second.t)))
        gaps[i, j] = gaps[j, i] = max(angle_between(first.R, second.R) / DISAGREE_RAD, relative / DISAGREE)
    middle = np.median(gaps, axis=1)
    if middle.min() > 1:
        raise BadInput(
            f"{names}: their {plural(len(candidates), 'shared picture')} disagree; take pictures of one number at the "
            "same time, or give --apart"
        )
    return candidates[int(middle.argmin())]
