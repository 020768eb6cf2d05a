"""Where observers stand on the page's floor, seen from above, by the views in the scene file. Pure.

Angles are degrees around the performer, 0 in front, 90 at the right hand (docs/reference/scene.md, `view`). An observer
whose view has no angle (from above, an unreadable camera file) is placed in the widest gap, so that none hides another.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

VIEW_AZIMUTHS_DEG = {"door": 0.0, "wheel": 90.0}
CORNER_DEG = 45.0
MIN_DISTANCE_DEG = 32.0
"""Two observers nearer to each other than this are moved apart while there is room."""
MAX_PASSES = 300

Matrix = Sequence[Sequence[float]]


@dataclass(frozen=True, slots=True)
class FloorPosition:
    """An observer's place. azimuth_deg: 0 to 360. known: whether the scene file gives it."""

    azimuth_deg: float
    known: bool
    view: str


def azimuth_of(view: str) -> float | None:
    """The angle of a view; None for `table`, camera files and invalid views."""
    words = view.strip()
    if words in VIEW_AZIMUTHS_DEG:
        return VIEW_AZIMUTHS_DEG[words]
    kind, _, number = words.partition(",")[0].partition(":")
    try:
        angle = float(number) if kind == "yaw" else math.nan
    except ValueError:
        return None
    return angle % 360 if math.isfinite(angle) else None


def azimuth_of_camera(matrix: Matrix) -> float | None:
    """The side from which a camera's (3, 4) matrix looks; None for one that looks straight down, or is invalid."""
    try:
        right, down, forward = (tuple(float(value) for value in row[:3]) for row in matrix)
        (a, b, c), (d, e, g) = right, down
        along: tuple[float, ...] = (b * g - c * e, c * d - a * g, a * e - b * d)
        if any(forward):
            side = sum(a * f for a, f in zip(along, forward, strict=True))
            along = tuple(math.copysign(1, side) * value for value in forward)
        x, _, z = along
    except (TypeError, ValueError):
        return None
    size = math.hypot(*along)
    if not math.isfinite(size) or math.hypot(x, z) <= 1e-6 * size:
        return None
    return math.degrees(math.atan2(-x, z)) % 360


def floor_positions(views: Mapping[str, str], azimuths: Mapping[str, float | None]) -> dict[str, FloorPosition]:
    """Every observer's position: at its angle if that is known, else in the widest gap, none upon another."""
    angles: dict[str, float] = {name: angle for name in views if (angle := azimuths.get(name)) is not None}
    unknown = [name for name in views if name not in angles]
    if not angles:
        angles = {name: (CORNER_DEG + 360 * i / len(unknown)) % 360 for i, name in enumerate(unknown)}
    for name in unknown:
        if name not in angles:
            angles[name] = _widest_gap(list(angles.values()))
    final = _moved_apart(angles)
    return {name: FloorPosition(round(final[name], 1) % 360, name not in unknown, views[name]) for name in views}


def _widest_gap(angles: Sequence[float]) -> float:
    around = sorted(angles)
    gaps = [(second - first, first) for first, second in zip(around, [*around[1:], around[0] + 360], strict=True)]
    width, start = max(gaps)
    return (start + width / 2) % 360


def _moved_apart(angles: Mapping[str, float]) -> dict[str, float]:
    """The same with no two nearer than MIN_DISTANCE_DEG, or than an even share of the circle in a crowd."""
    least = min(MIN_DISTANCE_DEG, 0.9 * 360 / max(1, len(angles)))
    names = sorted(angles, key=lambda name: angles[name])
    at = [angles[name] for name in names]
    for _ in range(MAX_PASSES if len(at) > 1 else 0):
        moved = False
        for i, this in enumerate(at):
            after = (i + 1) % len(at)
            lacking = least - ((at[after] + (360 if after <= i else 0)) - this)
            if lacking > 1e-3:
                at[i], at[after], moved = at[i] - lacking / 2, at[after] + lacking / 2, True
        if not moved:
            break
    return dict(zip(names, at, strict=True))
