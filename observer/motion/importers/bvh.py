"""Imports BVH motion capture: body parts by the names of their joints, in the archive's axes and in metres.

A BVH file states neither units nor axes nor the direction in which the performer faces. The archive's axes come from
the body: up is from the hips to the head, right is from the left hip (or shoulder) to the right one in the first frame,
and the back completes them. Units come from the size of the skeleton.
"""

import re
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from common.errors import BadInput
from observer.motion.archive import MotionArchive, Recording, check_recording, clean_label
from observer.motion.importers.base import ImportResult, Progress, counted, files_at, rate_from
from observer.motion.importers.bvh_file import BvhMotion, Joint, joint_positions, read_bvh
from observer.tracks import WHOLE_BODY, Floats

_EFFORT_NAME = re.compile(r"(.*[A-Za-z].*?)_(-?[01]_-?[01]_-?[01]_-?[01])")
"""<action>_<Space>_<Weight>_<Time>_<Flow>, each factor -1, 0 or 1 (PERFORM, Durupinar et al. 2016)."""

_SIDED = {
    "hand": ("{side}hand", "{s}hand", "hand{side}", "hand{s}", "{side}wrist", "{s}wrist", "wrist{side}", "wrist{s}"),
    "hip": ("{side}upleg", "{side}hip", "{side}thigh", "{side}upperleg", "{s}hip", "{s}thigh", "{side}femur",
            "{s}femur", "thigh{side}", "thigh{s}", "upperleg{s}", "upleg{s}"),
    "shoulder": ("{side}arm", "{side}upperarm", "{side}shoulder", "{s}upperarm", "{s}shldr", "{s}shoulder",
                 "{side}humerus", "{s}humerus", "upperarm{side}", "upperarm{s}", "shoulder{s}", "arm{s}"),
    "elbow": ("{side}forearm", "{side}lowerarm", "{side}elbow", "{s}forearm", "{s}elbow", "{side}radius", "{s}radius",
              "forearm{side}", "forearm{s}", "lowerarm{s}", "elbow{s}"),
    "knee": ("{side}leg", "{side}lowerleg", "{side}knee", "{side}shin", "{side}calf", "{s}shin", "{s}calf", "{s}knee",
             "{side}tibia", "{s}tibia", "shin{s}", "calf{s}", "knee{s}", "lowerleg{s}"),
    "foot": ("{side}foot", "{side}ankle", "{s}foot", "{s}ankle", "foot{side}", "foot{s}"),
    "toe": ("{side}toebase", "{side}toe", "{side}toes", "{s}toe", "{s}toes", "toe{s}", "toes{s}", "toebase{s}"),
}  # fmt: skip
"""Names of joints in files of different makers, in lower case, letters and digits only; the best first."""
_MIDDLE_JOINTS = {"head": ("head",), "neck": ("neck",), "pelvis": ("hips", "pelvis", "root")}
_NEEDED_PARTS = ("left_hand", "right_hand", "head")

_MIRRORED = 0.5
"""Cosine from which the feet point backwards so clearly that left and right are exchanged: a mirrored file."""
_UNITS = ((10.0, 1.0, "metres"), (1000.0, 0.01, "centimetres"), (np.inf, 0.001, "millimetres"))
"""A skeleton up to this many units tall: metres in one unit, and its name."""
_PLAUSIBLE = (0.5, 3.0)
"""Metres from head to foot; outside this range the note warns that the unit is a guess."""


def import_files(path: Path, progress: Progress | None = None) -> ImportResult:
    """The .bvh file `path`, or those in this folder (or just below it), one recording each.

    waving_0_1_-1_1.bvh gives label "waving" and trial "0_1_-1_1"; any other name gives the label alone, with
    trial "1". The subject is "1". The body parts are those of WHOLE_BODY that all files have. Raises BadInput for a
    broken file, or if no joint has an expected name.
    """
    files = files_at(path, "*.[bB][vV][hH]", ".bvh files")
    recordings, parts_of_files = [], []
    assumed: Counter[str] = Counter()
    for file in counted(files, len(files), progress):
        label, trial = _named(file)
        motion = read_bvh(file)
        parts = _joints_of_parts(motion.joints, file)
        positions, notes = _positions(motion, parts, file)
        recording = Recording(positions.astype(np.float32), rate_from(motion.frame_time), label, "1", trial)
        check_recording(recording, len(parts), str(file))
        recordings.append(recording)
        parts_of_files.append(tuple(parts))
        assumed.update(notes)
    lines = tuple(f"{text} ({count} of {len(files)} files)" for text, count in assumed.items())
    common = tuple(part for part in parts_of_files[0] if all(part in parts for parts in parts_of_files))
    recordings = [
        replace(r, positions=r.positions[:, [parts.index(part) for part in common]])
        for r, parts in zip(recordings, parts_of_files, strict=True)
    ]
    return ImportResult(MotionArchive(common, tuple(recordings)), lines)


def _named(file: Path) -> tuple[str, str]:
    """Label and trial, from the name of a file."""
    effort = _EFFORT_NAME.fullmatch(file.stem)
    label, trial = clean_label(effort[1] if effort else file.stem), effort[2] if effort else "1"
    if not label:
        raise BadInput(
            f"{file}: its name must contain the movement; letters or digits are expected, such as waving.bvh"
        )
    return label, trial


def _joints_of_parts(joints: tuple[Joint, ...], file: Path) -> dict[str, int]:
    """Index of the joint of each part of WHOLE_BODY that has one; raises BadInput without a hand or the head."""
    parts = {}
    for part in WHOLE_BODY:
        side, _, name = part.rpartition("_")
        names = _sided(name, side) if side else _MIDDLE_JOINTS[part]
        joint = _joint_named(joints, names)
        if joint is not None:
            parts[part] = joint
        elif part in _NEEDED_PARTS:
            what, expected = part.replace("_", " "), ", ".join(names[:3])
            raise BadInput(f"{file}: no joint for the {what}: {expected} or the like is expected; {_known(joints)}")
    return parts


def _positions(motion: BvhMotion, parts: dict[str, int], file: Path) -> tuple[Floats, tuple[str, ...]]:
    """(F, P, 3) body parts in metres and the archive's axes, and the assumptions made."""
    places = joint_positions(motion)
    axes, notes = _axes(motion.joints, places, parts["head"], file)
    scale, unit = _unit(places[0])
    # The performer starts above the origin; the height stays as recorded.
    origin = places[0, 0] - np.dot(places[0, 0], axes[1]) * axes[1]
    return (places[:, list(parts.values())] - origin) @ axes.T * scale, (unit, *notes)


def _axes(joints: tuple[Joint, ...], places: Floats, head: int, file: Path) -> tuple[Floats, tuple[str, ...]]:
    """Rows: the archive's x, y, z in the file's axes, orthonormal; and notes on unusual axes."""
    left, right = _pair(joints, file)
    hips = (places[:, left] + places[:, right]) / 2
    above = (places[:, head] - hips).mean(axis=0)
    axis = int(np.abs(above).argmax())
    up = np.zeros(3)
    up[axis] = np.sign(above[axis]) or 1.0
    across = places[0, right] - places[0, left]
    across = across - np.dot(across, up) * up
    if np.linalg.norm(across) < 1e-9:
        raise BadInput(f"{file}: frame 0: one hip is above the other; a standing performer is expected")
    across /= np.linalg.norm(across)
    back = np.cross(across, up)
    notes = [f"took {'+' if up[axis] > 0 else '-'}{'xyz'[axis]} as up"] if up[1] != 1.0 else []
    if _toes_point(joints, places[0], back) > _MIRRORED:
        notes.append("the toes point backwards: took the file as mirrored (left-handed axes)")
        back = -back
    return np.array([across, up, back]), tuple(notes)


def _toes_point(joints: tuple[Joint, ...], places: Floats, direction: Floats) -> float:
    """Cosine between the sum of both feet, from ankle to toe, and `direction`; 0 without toes."""
    feet = np.zeros(3)
    for side in ("left", "right"):
        foot, toe = _joint_named(joints, _sided("foot", side)), _joint_named(joints, _sided("toe", side))
        if foot is not None and toe is not None:
            feet += places[toe] - places[foot]
    length = float(np.linalg.norm(feet))
    return float(np.dot(feet, direction)) / length if length > 0 else 0.0


def _pair(joints: tuple[Joint, ...], file: Path) -> tuple[int, int]:
    """Left and right hip, or shoulder."""
    for name in ("hip", "shoulder"):
        left, right = _joint_named(joints, _sided(name, "left")), _joint_named(joints, _sided(name, "right"))
        if left is not None and right is not None:
            return left, right
    raise BadInput(f"{file}: no pair of hips or shoulders, such as LeftUpLeg and RightUpLeg; {_known(joints)}")


def _unit(places: Floats) -> tuple[float, str]:
    """Metres in one unit, estimated from one frame (J, 3), and the note that says so.

    The largest extent counts, so that stretched arms or a lying person change little.
    """
    size = float(np.ptp(places, axis=0).max())
    metres, name = next((metres, name) for most, metres, name in _UNITS if size <= most)
    tall = size * metres
    doubt = "" if _PLAUSIBLE[0] <= tall <= _PLAUSIBLE[1] else f", though one is then {tall:.2g} m tall"
    return metres, f"BVH states no unit: took {name}{doubt}"


def _sided(joint: str, side: str) -> tuple[str, ...]:
    return tuple(name.format(side=side, s=side[0]) for name in _SIDED[joint])


def _joint_named(joints: tuple[Joint, ...], names: tuple[str, ...]) -> int | None:
    """Index of the joint with the best of `names`: exact, else after a prefix such as "Bip01 " or "mixamorig:"."""
    plain = [re.sub(r"[^a-z0-9]", "", joint.name.lower()) for joint in joints]
    for name in names:
        if name in plain:
            return plain.index(name)
    for name in names:
        for index, joint in enumerate(plain):
            if joint.endswith(name):
                return index
    return None


def _known(joints: tuple[Joint, ...]) -> str:
    names = [joint.name[:20] for joint in joints if joint.name]
    return f"there are: {', '.join(names[:8])}{', ...' if len(names) > 8 else ''}"
