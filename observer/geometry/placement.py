"""Where a person stands and faces in the room of calibrated cameras, and where on its floor a picture shows them. Pure.

A part whose height y above the floor is known has a place x, z that is linear in the picture: with the rows h1, h2, h3
of the projective matrix, (h1 - u h3) (x, y, z, 1)ᵀ = 0 and (h2 - v h3) (x, y, z, 1)ᵀ = 0 (Hartley and Zisserman, 7.1).
Who bends, sits, or is taller changes the heights of all parts above the feet together. So how upright the person is, a
normal variable, is estimated with x and z, by least squares weighted by the standard deviations of STANDING.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.geometry.projection import oriented
from observer.tracks import Floats

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


STANDING = {
    "foot": (0.05, 0.04, 0.15), "hip": (0.62, 0.1, 0.1), "pelvis": (0.63, 0.1, 0.08), "shoulder": (0.83, 0.15, 0.12),
    "neck": (0.86, 0.15, 0.1), "head": (1.0, 0.15, 0.12),
}  # fmt: skip
"""Parts that tell where somebody stands: the height of the part, the standard deviation of that height while people
move, and of the distance from the middle of the body on the floor, all in heights of the head. Medians of the training
people of MSR Action3D; the deviations are twice theirs, because those people do not bow or walk."""
COMMON = 0.85
"""Share of the variance of these heights that all parts but the feet have in common: the mean correlation with the
height of the head, .74 to .96, of the same people. That of the feet is .2."""
SEEN_PX = 4.0
"""Standard deviation of a tracker's centres."""
ROOM_M = 3.0
"""Standard deviation of the place of a person of whom nothing is known: as large as a room."""
LEAST_M = 0.1
"""What is common to all parts, such as a lean, leaves this much."""
ROUNDS = 3
"""The weights of a pinhole camera depend on the distance; it is known after the second."""


def floor_place(
    matrix: Floats, parts: Sequence[str], centres: Floats, head_m: float, expected: tuple[float, float] = (0.0, 0.0)
) -> tuple[Floats, Floats] | None:
    """The place (2,) x and z in metres, and its covariance (2, 2); None if no part that tells it is seen.

    centres: (P, 2) undistorted px of the camera of `matrix`, (3, 4). head_m: height of the middle of the head of a
    person who stands. expected: where people are when nothing is known, ROOM_M wide.
    """
    rows = [(n, kind) for n, part in enumerate(parts) if (kind := part.rpartition("_")[2]) in STANDING]
    rows = [(n, kind) for n, kind in rows if np.isfinite(centres[n]).all()]
    if not rows:
        return None
    H = oriented(matrix)
    height, spread, aside = head_m * np.array([STANDING[kind] for _, kind in rows]).T
    common = np.array([0.0 if kind == "foot" else COMMON for _, kind in rows])
    seen = centres[[n for n, _ in rows]]
    # (2, K, 4): the equation of u and that of v of each part; (2, K, 3): of x, z, and how upright the person is.
    equations = np.stack([H[0] - seen[:, :1] * H[2], H[1] - seen[:, 1:] * H[2]])
    A = np.stack([equations[..., 0], equations[..., 2], equations[..., 1] * spread * np.sqrt(common)], axis=-1)
    b = -(equations[..., 1] * height + equations[..., 3])
    prior = np.diag([ROOM_M**-2, ROOM_M**-2, 1.0])
    at = start = np.array([*expected, 0.0])
    for _ in range(ROUNDS):
        depth = H[2, 0] * at[0] + H[2, 1] * height + H[2, 2] * at[1] + H[2, 3]
        # Centres are in px; those of a parallel view are in metres, as exact as the parts.
        variance = (depth * SEEN_PX * H[2, :3].any()) ** 2 + (equations[..., 1] * spread) ** 2 * (1 - common)
        variance += (A[..., :2] ** 2).sum(axis=-1) * aside**2
        weights = 1.0 / np.maximum(variance, 1e-12)
        covariance = np.linalg.inv(np.einsum("ek,eki,ekj->ij", weights, A, A) + prior)
        at = covariance @ (np.einsum("ek,eki->i", weights * b, A) + prior @ start)
    return at[:2], covariance[:2, :2] + LEAST_M**2 * np.eye(2)
