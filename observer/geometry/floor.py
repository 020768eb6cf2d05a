"""Where a person stands on the floor of the room, from the parts of their body in one picture. Pure.

A part whose height y above the floor is known has a place x, z that is linear in the picture: with the rows h1, h2, h3
of the projective matrix, (h1 - u h3) (x, y, z, 1)ᵀ = 0 and (h2 - v h3) (x, y, z, 1)ᵀ = 0 (Hartley and Zisserman, 7.1).
Who bends, sits, or is taller changes the heights of all parts above the feet together. So how upright the person is, a
normal variable, is estimated with x and z, by least squares weighted by the standard deviations below.
"""

from collections.abc import Sequence

import numpy as np

from observer.geometry.projection import Floats, oriented

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
        variance = (depth * SEEN_PX * _is_perspective(H)) ** 2 + (equations[..., 1] * spread) ** 2 * (1 - common)
        variance += (A[..., :2] ** 2).sum(axis=-1) * aside**2
        weights = 1.0 / np.maximum(variance, 1e-12)
        covariance = np.linalg.inv(np.einsum("ek,eki,ekj->ij", weights, A, A) + prior)
        at = covariance @ (np.einsum("ek,eki->i", weights * b, A) + prior @ start)
    return at[:2], covariance[:2, :2] + LEAST_M**2 * np.eye(2)


def _is_perspective(H: Floats) -> bool:
    """Whether centres are in px; those of a parallel view are in metres, as exact as the parts."""
    return bool(H[2, :3].any())
