"""The skin's colour over an ellipsoid: light on hand and head, and on the head hair, eyes, nose and mouth; pure."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from observer.rendering.look import Look
from observer.tracks import Floats

Plane = NDArray[np.float32]

HAIRLINE_AT = (-1.0, -0.35, 0.05, 0.3, 0.5)
HAIRLINE = (0.60, 0.50, 0.05, -0.1, -0.75)
"""Hair grows above these heights at these places front (-1) to back (1), all in semi-axes of the head."""


def complexion(
    surface: Sequence[Plane], axes: Floats, inward: Floats, look: Look, is_head: bool
) -> NDArray[np.float32]:
    """(h, w, 3) colours at the points `surface` (x right, y up, z back, each (h, w), on the unit ball).

    axes (3, 3) turns that ball into metres; inward (3,) is the direction of looking, on the ball.
    """
    shade = _light(surface, axes, inward)[..., None]
    skin = np.array(look.skin, np.float32)
    if not is_head:
        return shade * skin
    x, y, z = surface
    face = _features(x, y, z)
    ruddy = np.array([0.55, 0.6, 0.95], np.float32)
    colours = skin * (1.0 - face[0][..., None]) * (1.0 - face[1][..., None] * (1.0 - ruddy))
    hair = np.clip((y - _hairline(z)) / 0.08 + 0.5, 0.0, 1.0)[..., None]
    mixed: NDArray[np.float32] = shade * (colours + hair * (np.array(look.hair, np.float32) - colours))
    return mixed


def _light(surface: Sequence[Plane], axes: Floats, inward: Floats) -> Plane:
    """Soft light from above and from the camera's side: 0.56 to 1.08."""
    sight = axes @ inward
    sight = sight / np.linalg.norm(sight)
    # The normal of an ellipsoid at A n is A⁻ᵀ n: the gradient of |A⁻¹ x|².
    gradient = np.linalg.inv(axes).T
    normal = [sum(float(gradient[i, j]) * surface[j] for j in range(3)) for i in range(3)]
    length = np.sqrt(sum(n * n for n in normal)) + 1e-6
    facing = -sum(float(s) * n for s, n in zip(sight, normal, strict=True)) / length
    shade: Plane = (0.68 + 0.28 * np.maximum(facing, 0.0) + 0.12 * normal[1] / length).astype(np.float32)
    return shade


def _hairline(z: Plane) -> Plane:
    return np.interp(z, HAIRLINE_AT, HAIRLINE).astype(np.float32)


def _features(x: Plane, y: Plane, z: Plane) -> tuple[Plane, Plane]:
    """How dark (h, w), 0 to 1, and how red: sockets, eyes, brows, the nose's shadow; the mouth."""
    front = np.clip(-3.0 * z, 0.0, 1.0)
    side = np.absolute(x).astype(np.float32)
    dark = 0.35 * _spot(side - 0.40, y - 0.10, 0.26, 0.15)
    dark = np.maximum(dark, 0.85 * _spot(side - 0.40, y - 0.06, 0.13, 0.07))
    dark = np.maximum(dark, 0.65 * _spot(side - 0.42, y - 0.25, 0.24, 0.055))
    dark = np.maximum(dark, 0.30 * _spot(side - 0.12, y + 0.26, 0.10, 0.06))
    dark = np.maximum(dark, 0.30 * _spot(x, y + 0.545, 0.30, 0.03))
    return front * dark, front * _spot(x, y + 0.54, 0.30, 0.085)


def _spot(x: NDArray[np.floating], y: NDArray[np.floating], half_width: float, half_height: float) -> Plane:
    """1 in the middle, about half at the rim of an ellipse, 0 far outside."""
    spot: Plane = np.exp(-0.7 * ((x / half_width) ** 2 + (y / half_height) ** 2)).astype(np.float32)
    return spot
