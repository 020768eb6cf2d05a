"""The shapes that make up a clothed figure: tubes and hulls of cloth, ellipsoids of skin; pure."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from observer.rendering.body import HEAD, LEFT, RIGHT, Arm, Pose
from observer.rendering.look import Bgr, Look
from observer.tracks import Floats

HEAD_SEMI_AXES = (0.078, 0.115, 0.096)
"""Metres: half the width, height and depth of the head."""
HAND_SEMI_AXES = (0.045, 0.09, 0.045)
"""Metres: half the width and length of the hand, which is as thick as wide: how the palm is turned is not known."""

FARTHER, NEARER = 0.12, -0.06
"""Metres added to a distance where two shapes meet and one belongs on top: sleeves over the trunk, that over legs."""


@dataclass(frozen=True, slots=True, eq=False)
class Cloth:
    """The hull of balls: points (K, 3), radii (K,) metres. bias: metres added to its distance when ordering."""

    points: Floats
    radii: Floats
    colour: Bgr
    bias: float = 0.0

    @property
    def place(self) -> Floats:
        """(3,) its middle."""
        middle: Floats = self.points.mean(axis=0)
        return middle


@dataclass(frozen=True, slots=True, eq=False)
class Skin:
    """The ellipsoid of a body part: axes (3, 3), columns its semi-axes: performer's right, up or along, back."""

    part: int
    place: Floats
    axes: Floats
    bias: float = 0.0


Shape = Cloth | Skin


def shapes(pose: Pose, look: Look) -> list[Shape]:
    """The figure's shapes in any order; those of a part that is not seen, and its sleeve, are left out."""
    found: list[Shape] = [*_legs(pose, look), *_trunk(pose, look)]
    for part, arm in ((LEFT, pose.arms[0]), (RIGHT, pose.arms[1])):
        if arm is not None:
            found += _sleeve_and_hand(part, arm, pose.across, look)
    if pose.head is not None:
        # The shoulders may turn; the face looks where the performer faces, along -z.
        right = np.array([1.0, 0.0, 0.0])
        back = np.cross(right, pose.spine)
        up = np.cross(back, right)
        axes = np.column_stack([right, up / np.linalg.norm(up), back / np.linalg.norm(back)])
        found.append(Skin(HEAD, pose.head, axes * HEAD_SEMI_AXES))
    return found


def _trunk(pose: Pose, look: Look) -> Iterator[Cloth]:
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
    yield Cloth(points, np.array([0.052, 0.052, 0.108, 0.108, 0.085, 0.1, 0.1]), look.shirt)
    # A high collar: who seeks skin finds head and hands, nothing between.
    yield Cloth(np.stack([chest, chest + 0.085 * spine]), np.array([0.062, 0.054]), look.shirt, FARTHER)


def _sleeve_and_hand(part: int, arm: Arm, across: Floats, look: Look) -> Iterator[Shape]:
    along = arm.along
    wrist = arm.hand - (HAND_SEMI_AXES[1] + 0.01) * along
    yield Cloth(np.stack([arm.shoulder, arm.elbow]), np.array([0.058, 0.045]), look.shirt, NEARER)
    yield Cloth(np.stack([arm.elbow, wrist]), np.array([0.045, 0.034]), look.shirt, NEARER)
    side = np.cross(along, across)
    if np.linalg.norm(side) < 1e-3:  # an arm straight out to the side
        side = np.cross(along, [0.0, 0.0, 1.0])
    side = side / np.linalg.norm(side)
    axes = np.column_stack([np.cross(along, side), along, side])
    yield Skin(part, arm.hand, axes * HAND_SEMI_AXES, NEARER)


def _legs(pose: Pose, look: Look) -> Iterator[Cloth]:
    for hip, knee, ankle in zip(pose.hips, pose.knees, pose.ankles, strict=True):
        yield Cloth(np.stack([hip, knee]), np.array([0.09, 0.066]), look.trousers, FARTHER)
        yield Cloth(np.stack([knee, ankle]), np.array([0.066, 0.052]), look.trousers, FARTHER)
        heel = ankle + np.array([0.0, -0.03, 0.03])
        toe = heel + np.array([0.0, -0.01, -0.19])
        yield Cloth(np.stack([heel, toe]), np.array([0.045, 0.035]), look.shoes, FARTHER)
