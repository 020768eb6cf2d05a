"""Reads BVH motion capture (Biovision hierarchy), and computes where every joint is in each frame."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from common.errors import BadInput
from common.text import plural
from observer.motion.importers.base import finite_number, number_rows, read_text, shown, whole_number
from observer.tracks import Floats


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


Words = Iterator[tuple[int, str]]

_CHANNELS = tuple(f"{axis}{kind}" for kind in ("position", "rotation") for axis in "xyz")
_MOTION = re.compile(r"^[ \t]*MOTION[ \t]*$", re.IGNORECASE | re.MULTILINE)
_FRAMES_HEAD = re.compile(
    r"\s*frames[ \t]*:[ \t]*(\S+)[ \t]*\n\s*frame[ \t]+time[ \t]*:[ \t]*(\S+)[ \t]*$", re.IGNORECASE
)


def read_bvh(path: Path) -> BvhMotion:
    """The motion in the BVH file at `path`; raises BadInput with the line and what was expected there."""
    text = read_text(path)
    motion = _MOTION.search(text)
    if motion is None:
        raise BadInput(f"{path}: no MOTION section; a whole BVH file is expected")
    joints = _hierarchy(path, text[: motion.start()])
    columns = sum(len(joint.channels) for joint in joints)
    values, frame_time = _motion(path, text, motion.end(), columns)
    return BvhMotion(joints, values, frame_time)


def _hierarchy(path: Path, text: str) -> tuple[Joint, ...]:
    words = ((number, word) for number, line in enumerate(text.splitlines(), 1) for word in line.split())
    _expect(path, words, "HIERARCHY")
    _expect(path, words, "ROOT")
    joints = [Joint(_name(path, words), -1)]
    open_joints = [0]
    while open_joints:
        _block_entry(path, words, joints, open_joints)
    for number, word in words:
        raise BadInput(f"{path}: line {number}: {shown(word)}: MOTION is expected after the one ROOT")
    return tuple(joints)


def _block_entry(path: Path, words: Words, joints: list[Joint], open_joints: list[int]) -> None:
    """One entry between the braces of the innermost open joint, which may close it or open another."""
    number, word = _next(path, words)
    joint = joints[open_joints[-1]]
    match word.lower():
        case "}":
            open_joints.pop()
        case "offset":
            joint.offset = np.array([_number(path, words) for _ in range(3)])
        case "channels":
            joint.channels = _channels(path, words)
        case "joint" | "end" as kind:
            name = _name(path, words)
            joints.append(Joint(name if kind == "joint" else "", open_joints[-1]))
            open_joints.append(len(joints) - 1)
        case _:
            raise BadInput(f"{path}: line {number}: {shown(word)}: OFFSET, CHANNELS, JOINT, End Site or }} is expected")


def _name(path: Path, words: Words) -> str:
    """The words up to the opening brace: some files have spaces in names."""
    name = [_next(path, words)]
    while name[-1][1] != "{":
        name.append(_next(path, words))
        if name[-1][1].lower() in ("offset", "channels", "}"):
            raise BadInput(f"{path}: line {name[-1][0]}: {shown(name[-1][1])}: {{ is expected after a joint's name")
    return " ".join(word for _, word in name[:-1])


def _channels(path: Path, words: Words) -> tuple[str, ...]:
    number, word = _next(path, words)
    count = whole_number(word, f"{path}: line {number}: CHANNELS")
    if count > len(_CHANNELS):
        raise BadInput(f"{path}: line {number}: {plural(count, 'channel')}; 0 to {len(_CHANNELS)} are expected")
    channels: list[str] = []
    for _ in range(count):
        number, channel = _next(path, words)
        if channel.lower() not in _CHANNELS or channel.lower() in channels:
            raise BadInput(f"{path}: line {number}: {shown(channel)}: a channel such as Zrotation is expected, once")
        channels.append(channel.lower())
    return tuple(channels)


def _next(path: Path, words: Words) -> tuple[int, str]:
    word = next(words, None)
    if word is None:
        raise BadInput(f"{path}: the hierarchy ends before its braces are closed; a whole BVH file is expected")
    return word


def _expect(path: Path, words: Words, wanted: str) -> None:
    number, word = _next(path, words)
    if word.lower() != wanted.lower():
        raise BadInput(f"{path}: line {number}: {shown(word)}: {wanted} is expected")


def _number(path: Path, words: Words) -> float:
    number, word = _next(path, words)
    return finite_number(word, f"{path}: line {number}")


def _motion(path: Path, text: str, start: int, columns: int) -> tuple[Floats, float]:
    """The values (F, columns) and the frame time; `start`: the position after the word MOTION."""
    first_line = text.count("\n", 0, start) + 2
    lines = text[start:].rstrip().split("\n")[1:]
    place = f"{path}: line {first_line}"
    head = _FRAMES_HEAD.match("\n".join(lines[:2]))
    if head is None:
        raise BadInput(f"{place}: 'Frames: N' and under it 'Frame Time: SECONDS' are expected")
    frames = whole_number(head[1], f"{place}: Frames")
    seconds = finite_number(head[2], f"{path}: line {first_line + 1}: Frame Time")
    if frames < 1 or seconds <= 0:
        raise BadInput(
            f"{place}: {plural(frames, 'frame')}, {seconds} s apart: at least 1 frame and a positive time expected"
        )
    rows = lines[2:]
    if len(rows) != frames:
        raise BadInput(f"{path}: {plural(len(rows), 'frame')}; {frames} expected, as line {first_line} says")
    return number_rows(path, rows, columns, first_line + 2), seconds


def joint_positions(motion: BvhMotion) -> Floats:
    """(F, J, 3) place of each joint by forward kinematics, in the file's units and axes.

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
    """(F, 3) place and (F, 3, 3) rotation of a joint relative to its parent."""
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
