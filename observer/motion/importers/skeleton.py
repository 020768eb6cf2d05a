"""A moving skeleton as BVH describes it, and forward kinematics: where every joint is in each frame; pure."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(slots=True)
class Joint:
    """One joint: its parent's index (-1 for the root), offset (3,) from it, channels such as "zrotation" in order.

    End sites are joints named "" without channels.
    """

    name: str
    parent: int
    offset: Floats = field(default_factory=lambda: np.zeros(3))
    channels: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class BvhMotion:
    """joints: parents before children. values: (F, C) one column a channel, joint after joint, degrees and units.

    frame_time: seconds from frame to frame.
    """

    joints: tuple[Joint, ...]
    values: Floats
    frame_time: float


def joint_positions(motion: BvhMotion) -> Floats:
    """(F, J, 3) forward kinematics: where each joint is, in the file's units and axes.

    With the parent's rotation R_p and position t_p, a joint is at t = t_p + R_p o and turns by R = R_p A_1 A_2 A_3,
    A_i the rotations about its channels' axes in the order that the file lists them. o is the offset; position
    channels add to it at the root and stand in its place elsewhere.
    """
    frames, count = len(motion.values), len(motion.joints)
    places = np.zeros((frames, count, 3))
    turns = np.zeros((count, frames, 3, 3))
    column = 0
    for index, joint in enumerate(motion.joints):
        values = motion.values[:, column : column + len(joint.channels)]
        column += len(joint.channels)
        local, turn = _local(joint, values)
        if joint.parent < 0:
            places[:, index], turns[index] = local, turn
        else:
            parent = turns[joint.parent]
            places[:, index] = places[:, joint.parent] + np.einsum("fij,fj->fi", parent, local)
            turns[index] = parent @ turn
    return places


def _local(joint: Joint, values: Floats) -> tuple[Floats, Floats]:
    """(F, 3) place and (F, 3, 3) rotation of a joint seen from its parent."""
    place = np.tile(joint.offset, (len(values), 1))
    turn = np.tile(np.eye(3), (len(values), 1, 1))
    for channel, column in zip(joint.channels, values.T, strict=True):
        axis = "xyz".index(channel[0])
        if channel.endswith("rotation"):
            turn = turn @ _about(axis, np.radians(column))
        else:
            place[:, axis] = column + (joint.offset[axis] if joint.parent < 0 else 0.0)
    return place, turn


def _about(axis: int, angle_rad: Floats) -> Floats:
    """(F, 3, 3) right-handed rotations about a coordinate axis."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    turn = np.tile(np.eye(3), (len(angle_rad), 1, 1))
    turn[:, first, first] = turn[:, second, second] = np.cos(angle_rad)
    turn[:, second, first] = np.sin(angle_rad)
    turn[:, first, second] = -np.sin(angle_rad)
    return turn
