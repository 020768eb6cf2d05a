"""All cameras from what they saw of a board: lenses, places in one room, errors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from common.errors import BadInput
from observer.calibration.board import Board
from observer.calibration.calibrated import Calibrated
from observer.calibration.detection import Sightings
from observer.calibration.extrinsics import Pose, placed
from observer.calibration.intrinsics import Lens
from observer.geometry.projection import Floats

HELD = Pose(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))
"""From the board to the room when the performer holds it before him, upright, printed side forward."""

LYING = Pose(np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]), np.zeros(3))
"""From the board to the room when it lies before the performer's feet, as he would read it."""


@dataclass(frozen=True, slots=True, eq=False)
class BoardResult:
    """cameras: as calibrated. origin: the number of the picture whose board is the room's origin.

    drawn: by camera, by picture number, (N, 2) pixels where the corners should be. errors_px: root mean square of each
    picture, by camera and number.
    """

    cameras: tuple[Calibrated, ...]
    origin: int
    drawn: dict[str, dict[int, Floats]]
    errors_px: dict[str, dict[int, float]]


def from_boards(
    seen: Sequence[Sightings], lenses: Mapping[str, Lens], board: Board, origin: int | None, lying: bool, apart: bool
) -> BoardResult:
    """Place cameras whose lenses are known. origin: a picture's number, or None for the one that most cameras share.

    apart: pictures of one number were not taken at the same time; each camera is placed by its own picture `origin`.
    Raises BadInput when no camera, or with `apart` some camera, sees the board in that picture; and as `placed` does.
    """
    number = _origin(seen, origin, apart)
    rooms = LYING if lying else HELD
    cameras: dict[str, Pose] = {}
    boards: dict[str, dict[int, Pose]] = {}
    for group in [[s] for s in seen] if apart else [list(seen)]:
        found = placed(group, lenses, board)
        to_room = rooms.after(found.boards[number].back)
        for s in group:
            cameras[s.name] = found.cameras[s.name].after(to_room.back)
            boards[s.name] = {n: to_room.after(pose) for n, pose in found.boards.items()}
    results, drawn, errors = [], {}, {}
    for s in seen:
        camera = _calibrated(s, lenses[s.name], cameras[s.name])
        drawn[s.name] = {n.number: camera.pixels(_moved(boards[s.name][n.number], board.points[n.ids])) for n in s.seen}
        off = {n.number: np.linalg.norm(drawn[s.name][n.number] - n.pixels, axis=1) for n in s.seen}
        errors[s.name] = {n: _rms(values) for n, values in off.items()}
        results.append(_with_error(camera, _rms(np.concatenate(list(off.values()))), board, s))
    return BoardResult(tuple(results), number, drawn, errors)


def _origin(seen: Sequence[Sightings], origin: int | None, apart: bool) -> int:
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


def _calibrated(s: Sightings, lens: Lens, pose: Pose) -> Calibrated:
    return Calibrated(s.name, lens.K, lens.distortion, pose.R, pose.t, s.image_size_px)


def _with_error(camera: Calibrated, error_px: float, board: Board, s: Sightings) -> Calibrated:
    told = f"{type(board).__name__.lower()} {board.columns}x{board.rows}, {board.square:g} m, {len(s.seen)} pictures"
    return Calibrated(
        camera.name, camera.K, camera.distortion, camera.R, camera.t, camera.image_size_px, error_px, told
    )


def _moved(pose: Pose, points: Floats) -> Floats:
    result: Floats = points @ pose.R.T + pose.t
    return result


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
