"""The clothed figure: colours of the performer, shapes of cloth and skin, and the shading of skin; pure."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.rendering.body import HEAD, LEFT, RIGHT, Arm, BodyPose
from observer.tracks import Floats

Bgr = tuple[float, float, float]
"""A colour in daylight, 0 to 255: blue, green, red."""

SKIN_TONES: tuple[Bgr, ...] = (
    *((180.0, 205.0, 240.0), (150.0, 180.0, 225.0), (120.0, 155.0, 205.0)),
    *((90.0, 125.0, 180.0), (65.0, 95.0, 145.0), (48.0, 70.0, 108.0)),
)
"""From very light to very dark, one per Fitzpatrick type; a person's tone is interpolated between two of them."""

# No clothes have the hue of skin, so that errors of a tracker are not due to clothes.
_HAIR: tuple[Bgr, ...] = ((24.0, 24.0, 28.0), (38.0, 42.0, 48.0), (120.0, 120.0, 118.0), (30.0, 32.0, 44.0))
_SHIRTS: tuple[Bgr, ...] = (
    *((130.0, 70.0, 30.0), (70.0, 105.0, 40.0), (120.0, 45.0, 95.0)),
    *((62.0, 58.0, 55.0), (150.0, 120.0, 40.0), (60.0, 80.0, 65.0)),
)
_TROUSERS: tuple[Bgr, ...] = ((70.0, 50.0, 40.0), (42.0, 40.0, 40.0), (95.0, 90.0, 86.0), (50.0, 60.0, 48.0))


@dataclass(frozen=True, slots=True)
class Appearance:
    """Colours of one person. skin: between two of SKIN_TONES; nothing else has the hue of skin."""

    skin: Bgr
    hair: Bgr
    shirt: Bgr
    trousers: Bgr
    shoes: Bgr = (30.0, 28.0, 28.0)


def appearance_of(seed: int) -> Appearance:
    """The appearance for a seed, 0 or more."""
    rng = np.random.default_rng((seed, 1))
    position = rng.uniform(0.0, len(SKIN_TONES) - 1.0)
    tone = [float(np.interp(position, range(len(SKIN_TONES)), channel)) for channel in zip(*SKIN_TONES, strict=True)]
    hair, shirt, trousers = (colours[rng.integers(len(colours))] for colours in (_HAIR, _SHIRTS, _TROUSERS))
    return Appearance((tone[0], tone[1], tone[2]), hair, shirt, trousers)


Plane = NDArray[np.float32]

HAIRLINE_AT = (-1.0, -0.35, 0.05, 0.3, 0.5)
HAIRLINE = (0.60, 0.50, 0.05, -0.1, -0.75)
"""Height of the hairline at positions from front (-1) to back (1), in semi-axes of the head."""


def complexion(
    surface: Sequence[Plane], axes: Floats, inward: Floats, appearance: Appearance, is_head: bool
) -> NDArray[np.float32]:
    """(h, w, 3) colours at the points `surface` (x right, y up, z back, each (h, w), on the unit sphere).

    axes: (3, 3) maps that sphere to metres. inward: (3,) viewing direction in the sphere's coordinates.
    """
    shade = _light(surface, axes, inward)[..., None]
    skin = np.array(appearance.skin, np.float32)
    if not is_head:
        return shade * skin
    x, y, z = surface
    face = _features(x, y, z)
    ruddy = np.array([0.55, 0.6, 0.95], np.float32)
    colours = skin * (1.0 - face[0][..., None]) * (1.0 - face[1][..., None] * (1.0 - ruddy))
    hair = np.clip((y - np.interp(z, HAIRLINE_AT, HAIRLINE).astype(np.float32)) / 0.08 + 0.5, 0.0, 1.0)[..., None]
    mixed: NDArray[np.float32] = shade * (colours + hair * (np.array(appearance.hair, np.float32) - colours))
    return mixed


def _light(surface: Sequence[Plane], axes: Floats, inward: Floats) -> Plane:
    """Soft light from above and from the camera: 0.56 to 1.08."""
    sight = axes @ inward
    sight = sight / np.linalg.norm(sight)
    # The normal of an ellipsoid at A n is A⁻ᵀ n: the gradient of |A⁻¹ x|².
    gradient = np.linalg.inv(axes).T
    normal = [sum(float(gradient[i, j]) * surface[j] for j in range(3)) for i in range(3)]
    length = np.sqrt(sum(n * n for n in normal)) + 1e-6
    facing = -sum(float(s) * n for s, n in zip(sight, normal, strict=True)) / length
    return (0.68 + 0.28 * np.maximum(facing, 0.0) + 0.12 * normal[1] / length).astype(np.float32)


def _features(x: Plane, y: Plane, z: Plane) -> tuple[Plane, Plane]:
    """Darkness (h, w), 0 to 1, of sockets, eyes, brows and nose, and redness of the mouth."""
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
    return np.exp(-0.7 * ((x / half_width) ** 2 + (y / half_height) ** 2)).astype(np.float32)


HEAD_SEMI_AXES = (0.078, 0.115, 0.096)
"""Metres: half the width, height and depth of the head."""
HAND_SEMI_AXES = (0.045, 0.09, 0.045)
"""Metres: half the width and length of the hand, as thick as wide, since the orientation of the palm is unknown."""
FARTHER, NEARER = 0.12, -0.06
"""Metres added to the distance of overlapping shapes for the drawing order: sleeves over trunk, trunk over legs."""


@dataclass(frozen=True, slots=True, eq=False)
class ClothHull:
    """The hull of spheres: points (K, 3), radii (K,) metres. bias: metres added to its distance for the order."""

    points: Floats
    radii: Floats
    colour: Bgr
    bias: float = 0.0

    @property
    def centre(self) -> Floats:
        """(3,) mean of the points."""
        middle: Floats = self.points.mean(axis=0)
        return middle


@dataclass(frozen=True, slots=True, eq=False)
class SkinEllipsoid:
    """The ellipsoid of a body part. axes: (3, 3), columns are its semi-axes: performer's right, up or along, back."""

    part: int
    centre: Floats
    axes: Floats
    bias: float = 0.0


Shape = ClothHull | SkinEllipsoid


def shapes(pose: BodyPose, appearance: Appearance) -> list[Shape]:
    """The shapes of the figure in any order, without parts that are not seen and their sleeves."""
    result: list[Shape] = [*_legs(pose, appearance), *_trunk(pose, appearance)]
    for part, arm in ((LEFT, pose.arms[0]), (RIGHT, pose.arms[1])):
        if arm is not None:
            result += _sleeve_and_hand(part, arm, pose.across, appearance)
    if pose.head is not None:
        # The shoulders may twist; the face looks along -z.
        right = np.array([1.0, 0.0, 0.0])
        back = np.cross(right, pose.spine)
        up = np.cross(back, right)
        axes = np.column_stack([right, up / np.linalg.norm(up), back / np.linalg.norm(back)])
        result.append(SkinEllipsoid(HEAD, pose.head, axes * HEAD_SEMI_AXES))
    return result


def _trunk(pose: BodyPose, appearance: Appearance) -> Iterator[ClothHull]:
    across, spine, chest = pose.across, pose.spine, pose.chest
    hips = pose.hips.mean(axis=0)
    sides = np.array([-1.0, 1.0])[:, None] * across
    points = np.concatenate(
        [
            pose.shoulders * 0.88 + chest * 0.12,
            chest + 0.08 * sides - 0.17 * spine,
            chest[None] + 0.01 * spine,
            hips + 0.055 * sides + 0.02 * spine,
        ]
    )
    yield ClothHull(points, np.array([0.052, 0.052, 0.108, 0.108, 0.085, 0.1, 0.1]), appearance.shirt)
    # A high collar: only head and hands show skin.
    yield ClothHull(np.stack([chest, chest + 0.085 * spine]), np.array([0.062, 0.054]), appearance.shirt, FARTHER)


def _sleeve_and_hand(part: int, arm: Arm, across: Floats, appearance: Appearance) -> Iterator[Shape]:
    along = arm.along
    wrist = arm.hand - (HAND_SEMI_AXES[1] + 0.01) * along
    yield ClothHull(np.stack([arm.shoulder, arm.elbow]), np.array([0.058, 0.045]), appearance.shirt, NEARER)
    yield ClothHull(np.stack([arm.elbow, wrist]), np.array([0.045, 0.034]), appearance.shirt, NEARER)
    side = np.cross(along, across)
    if np.linalg.norm(side) < 1e-3:  # an arm straight out to the side
        side = np.cross(along, [0.0, 0.0, 1.0])
    side = side / np.linalg.norm(side)
    axes = np.column_stack([np.cross(along, side), along, side])
    yield SkinEllipsoid(part, arm.hand, axes * HAND_SEMI_AXES, NEARER)


def _legs(pose: BodyPose, appearance: Appearance) -> Iterator[ClothHull]:
    for hip, knee, ankle in zip(pose.hips, pose.knees, pose.ankles, strict=True):
        yield ClothHull(np.stack([hip, knee]), np.array([0.09, 0.066]), appearance.trousers, FARTHER)
        yield ClothHull(np.stack([knee, ankle]), np.array([0.066, 0.052]), appearance.trousers, FARTHER)
        heel = ankle + np.array([0.0, -0.03, 0.03])
        toe = heel + np.array([0.0, -0.01, -0.19])
        yield ClothHull(np.stack([heel, toe]), np.array([0.045, 0.035]), appearance.shoes, FARTHER)
