"""Limbs and joints of a body, and a trace as places and angles. Pure."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from observer.tracks import Floats, Floats32

SCORED_LIMBS = {
    "left arm": ("left_hand", "left_elbow", "left_shoulder"),
    "right arm": ("right_hand", "right_elbow", "right_shoulder"),
    "left leg": ("left_foot", "left_knee", "left_hip"),
    "right leg": ("right_foot", "right_knee", "right_hip"),
    "trunk": ("head", "neck", "pelvis"),
}
JOINTS = {
    "elbow": ("shoulder", "elbow", "hand"),
    "knee": ("hip", "knee", "foot"),
    "shoulder": ("elbow", "shoulder", "hip"),
    "hip": ("knee", "hip", "shoulder"),
}
"""Between which three parts of one side: the angle is at the second."""


class Limb(NamedTuple):
    """A limb, and the indices of those of its parts that there are."""

    name: str
    parts: tuple[int, ...]


class LimbJoint(NamedTuple):
    """`left knee`, its limb, and the indices of the three parts."""

    name: str
    limb: str
    parts: tuple[int, int, int]


def limbs_of(body_parts: Sequence[str]) -> tuple[Limb, ...]:
    """The limbs of which at least one part is tracked."""
    place = {name: n for n, name in enumerate(body_parts)}
    limbs = (Limb(name, tuple(place[part] for part in parts if part in place)) for name, parts in SCORED_LIMBS.items())
    return tuple(limb for limb in limbs if limb.parts)


def joints_of(body_parts: Sequence[str]) -> tuple[LimbJoint, ...]:
    """The joints whose three parts are tracked."""
    place = {name: n for n, name in enumerate(body_parts)}
    joints = []
    for side in ("left", "right"):
        for name, parts in JOINTS.items():
            first, middle, last = (place.get(f"{side}_{part}", -1) for part in parts)
            if min(first, middle, last) >= 0:
                limb = f"{side} {'arm' if name in ('elbow', 'shoulder') else 'leg'}"
                joints.append(LimbJoint(f"{side} {name}", limb, (first, middle, last)))
    return tuple(joints)


def places_of(trace: Floats32) -> Floats32:
    """(F, 2 P + 3) trace -> (F, P, 2) where each part is, from where the body was in the first frame; body sizes."""
    path = trace[:, None, -3:-1] - trace[0, -3:-1]
    return (trace[:, :-3].reshape(len(trace), -1, 2) + path).astype(np.float32)


def angles_of(places: Floats32, joints: Sequence[LimbJoint]) -> Floats:
    """(F, P, 2) places -> (F, J) degrees of the joints as this view sees them: 180 is straight."""
    angles = np.empty((len(places), len(joints)))
    for n, joint in enumerate(joints):
        first, middle, last = (places[:, part].astype(np.float64) for part in joint.parts)
        one, other = first - middle, last - middle
        cross = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
        angles[:, n] = np.degrees(np.abs(np.arctan2(cross, (one * other).sum(axis=1))))
    return angles
