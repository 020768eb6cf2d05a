"""All cameras from what they saw of a board: lenses, places in one room, errors."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from common.errors import BadInput
from observer.calibration.board import Board
from observer.calibration.bundle import Optics
from observer.calibration.calibrated import Calibrated
from observer.calibration.detection import Sightings
from observer.calibration.extrinsics import Pose, placed
from observer.calibration.intrinsics import FittedLens
from observer.geometry.projection import Floats

HELD = Pose(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))
"""From the board to the room when the performer holds it before him, upright, printed side forward."""

LYING = Pose(np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]), np.zeros(3))
"""From the board to the room when it lies before the performer's feet, as he would read it."""


@dataclass(frozen=True, slots=True, eq=False)
class BoardResult:
    """cameras: as calibrated. origin: the number of the picture whose board is the room's origin.

    drawn: by camera, by picture number, (N, 2) pixels where the corners should be. errors_px: root mean square of each
    picture, by camera and number. moments: root mean square of how far pictures of one number were apart, in pictures.
    back_m: how far the pattern on the board's back lies from the one in front. Both are accounted for in the rest.
    """

    cameras: tuple[Calibrated, ...]
    origin: int
    drawn: dict[str, dict[int, Floats]]
    errors_px: dict[str, dict[int, float]]
    moments: float
    back_m: float


def from_boards(
    seen: Sequence[Sightings],
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
    Raises BadInput when no camera, or with `apart` some camera, sees the board in that picture; and as `placed` does.
    """
    number = _origin(seen, origin, apart)
    rooms = LYING if lying else HELD
    cameras: list[Calibrated] = []
    off: dict[str, dict[int, Floats]] = {}
    moments, back_m = 0.0, 0.0
    for group in [[s] for s in seen] if apart else [list(seen)]:
        found = placed(group, lenses, board, adjust)
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


def _calibrated(s: Sightings, optics: Optics, pose: Pose, error_px: float, board: Board) -> Calibrated:
    told = f"{type(board).__name__.lower()} {board.columns}x{board.rows}, {board.square:g} m, {len(s.seen)} pictures"
    return Calibrated(s.name, *optics, pose.R, pose.t, s.image_size_px, error_px, told)


def _rms(off: Floats) -> float:
    """(N, 2) -> root mean square of the N distances."""
    return float(np.sqrt(np.mean((off**2).sum(axis=-1))))
