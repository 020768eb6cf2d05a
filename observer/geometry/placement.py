"""Where a person stands and faces in the room of calibrated cameras. Pure."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput

HEAD_M = 1.6
"""Height of the middle of a standing person's head above the floor, where it is not known."""
NEAR_M, NEAR_DEG = 0.5, 20.0
"""Placements within these distances are alike: people do not stand still, and models forgive that much."""


@dataclass(frozen=True, slots=True)
class PersonPlacement:
    """Where a person stands and faces, in the axes of a room whose y points up.

    x_m, z_m: the point on the floor below the head. head_m: height (y) of the middle of the head while the person
    stands. facing_deg: 0 faces along -z, towards where the view yaw:0 looks from; it grows to the person's left,
    counter-clockwise seen from above, so that 90 faces along -x. A camera in the direction yaw:V of the room sees this
    person as yaw:(V + facing_deg) sees one who faces 0.
    """

    x_m: float = 0.0
    z_m: float = 0.0
    head_m: float = HEAD_M
    facing_deg: float = 0.0

    @property
    def place(self) -> tuple[float, float, float]:
        """x, y, z of the head, as in the scene file."""
        return self.x_m, self.head_m, self.z_m

    def __str__(self) -> str:
        return f"[{', '.join(f'{metres:.2f}' for metres in self.place)}] m, facing {self.facing_deg:.0f} degrees"


def placement_of(place: Sequence[float] | None, facing_deg: float | None) -> PersonPlacement | None:
    """The placement of the keys `place`, [x, z] or [x, y, z] with the height y of the head, and `facing`.

    What is missing is the origin, HEAD_M or 0 degrees; None if both keys are missing.
    """
    if place is None and facing_deg is None:
        return None
    x, *head, z = place or (0.0, 0.0)
    return PersonPlacement(x, z, head[0] if head else HEAD_M, facing_deg or 0.0)


def parse_place(text: str) -> tuple[float, ...] | None:
    """`X,Z` or `X,Y,Z` in metres -> numbers; None for ""; raises BadInput for other texts."""
    if not text:
        return None
    try:
        place = tuple(float(piece) for piece in text.split(","))
    except ValueError:
        place = ()
    if len(place) not in (2, 3) or not all(map(math.isfinite, place)):
        raise BadInput(f"--place {text}: X,Z or X,Y,Z in metres is expected (Y: height of the head), e.g. 0.2,1.5")
    return place


def facing_of(right: NDArray[np.floating]) -> float:
    """(3,) direction of a person's right side in the room -> PersonPlacement's facing_deg, from -180 to 180."""
    return math.degrees(math.atan2(-float(right[2]), float(right[0])))


def unlike(placement: PersonPlacement, other: PersonPlacement, any_facing: bool = False) -> bool:
    """Whether a model for one placement fits the other badly; any_facing: the model knows all directions."""
    turn_deg = abs((placement.facing_deg - other.facing_deg + 180) % 360 - 180)
    return math.dist(placement.place, other.place) > NEAR_M or (turn_deg > NEAR_DEG and not any_facing)
